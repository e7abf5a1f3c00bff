/* Figures that move: charts that follow sliders, without a server.

   A cell shows one by inswsn_book.show.moving: a hidden <section class="moving"> with tables as JSON, in
   which the library has computed all that moves at every place of the sliders that it depends on.
   This script looks up and draws, and computes nothing. It puts the charts in the place of the still
   picture that the section names; without it, and in print, the picture stays. In JupyterLab the widget of
   inswsn_book.lab.widget holds this script, and builds its section alone. */
"use strict";

(() => {
  if (window.inswsnMoving) return; // included twice

  const SVG = "http://www.w3.org/2000/svg";
  const GAP = 14; // between the lines of labels

  function make(name, attributes = {}, ...children) {
    const node = name.startsWith("svg:") ? document.createElementNS(SVG, name.slice(4)) : document.createElement(name);
    for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
    node.append(...children);
    return node;
  }

  /** What a table holds where the sliders stand: the last of its sliders goes fastest. */
  const indexOf = (table, sliders, places) => table.by.reduce((index, name) => index * sliders[name].texts.length + places[name], 0);
  const found = (table, sliders, places) => table.values[indexOf(table, sliders, places)];

  const STEPS = 10000;
  const SIGNS = String.fromCharCode(...Array.from({ length: 94 }, (_, i) => 33 + i)).replace(/["<\\`]/g, "");
  const BASE = SIGNS.length / 2;

  /** The numbers that moving.py has written as the steps from one to the next along an axis. */
  function numbersOf(text, [low, high]) {
    const found = [];
    let [at, step, size] = [0, 0, 1];
    for (const sign of text) {
      const digit = SIGNS.indexOf(sign);
      step += (digit % BASE) * size;
      size *= BASE;
      if (digit >= BASE) continue;
      at += step % 2 ? -(step + 1) / 2 : step / 2;
      found.push(low + (at / STEPS) * (high - low));
      [step, size] = [0, 1];
    }
    return found;
  }

  /** What a section shows: its JSON, in which coordinates may be such texts. */
  function read(root) {
    const content = JSON.parse(root.querySelector("script").textContent);
    for (const [i, chart] of content.charts.entries()) {
      chart.tall = [330, 250, 200][Math.min(content.charts.length, 3) - 1]; // they have to be seen at once
      if (JSON.stringify(chart.x) === JSON.stringify(content.charts[i + 1]?.x)) { // the chart below says it
        chart.x = { ...chart.x, label: "", ticks: chart.x.ticks.map(([value]) => [value, ""]) };
      }
      const { x, y, series } = chart;
      for (const each of series) {
        let xs;
        each.values = each.values.map(([along, ...others]) => {
          if (Array.isArray(others[0])) return [along, ...others];
          if (along !== null) xs = numbersOf(along, x.ends);
          return [xs, ...others.map((text) => numbersOf(text, y.ends))];
        });
      }
    }
    return content;
  }

  /** The width of a label in the font of the page: fonts differ by a third. */
  function widthOf(text) {
    const pen = document.createElement("canvas").getContext("2d");
    pen.font = `600 13px ${getComputedStyle(document.body).fontFamily}`;
    return pen.measureText(text).width;
  }

  /** The box of a chart, and the functions from its axes to the picture. */
  function frameOf(chart, width, beside) {
    const box = { left: 52, right: width - beside - 16, top: 26 };
    const [x, y] = [chart.x.ends, chart.y.ends];
    const across = (box.right - box.left) / (x[1] - x[0]);
    const tall = chart.equal ? Math.min((y[1] - y[0]) * across, width < 500 ? 200 : chart.tall) : Math.min(190, 0.7 * Math.min(width, chart.tall));
    box.bottom = box.top + tall;
    const up = tall / (y[1] - y[0]);
    const wide = chart.equal ? Math.min(across, up) : across;
    box.right = box.left + (x[1] - x[0]) * wide;
    const inside = (value, [low, high]) => Math.min(Math.max(value, low), high);
    return {
      box,
      height: box.bottom + (chart.x.label ? 40 : 6),
      wide,
      start: [x[0], y[0]],
      x: (value) => box.left + (inside(value, x) - x[0]) * wide,
      y: (value) => box.bottom - (inside(value, y) - y[0]) * (chart.equal ? wide : up),
    };
  }

  function axesOf(chart, frame, width) {
    const { box } = frame;
    const parts = [];
    for (const [value, text] of chart.y.ticks) {
      const at = frame.y(value);
      parts.push(
        make("svg:line", { class: "moving-grid", x1: box.left, x2: box.right, y1: at, y2: at }),
        make("svg:text", { x: box.left - 6, y: at + 4, "text-anchor": "end" }, text),
      );
    }
    for (const [value, text] of chart.x.ticks) {
      const at = frame.x(value);
      parts.push(
        make("svg:line", { class: "moving-grid", x1: at, x2: at, y1: box.top, y2: box.bottom }),
        make("svg:text", { x: at, y: box.bottom + 17, "text-anchor": "middle" }, text),
      );
    }
    const middle = (box.top + box.bottom) / 2;
    const room = width - 4 - widthOf(chart.title);  // a title that is wider than its picture is drawn together
    const fitted = room < 0 ? { textLength: width - 4, lengthAdjust: "spacingAndGlyphs" } : {};
    parts.push(
      make("svg:text", { class: "moving-title", x: Math.max(0, Math.min(box.left, room)), y: 15, ...fitted }, chart.title),
      make("svg:text", { x: (box.left + box.right) / 2, y: box.bottom + 35, "text-anchor": "middle" }, chart.x.label),
      make("svg:text", { x: 12, y: middle, transform: `rotate(-90 12 ${middle})`, "text-anchor": "middle" }, chart.y.label),
    );
    return parts.filter((part) => part.localName !== "text" || part.textContent); // of a shared axis
  }

  function seriesOf(series, values, frame, [colour, dashes]) {
    const [xs, ys, tops] = values;
    const points = xs.map((x, i) => [frame.x(x).toFixed(1), frame.y(ys[i]).toFixed(1)]);
    if (series.style === "points") return points.map(([cx, cy]) => make("svg:circle", { fill: colour, cx, cy, r: 2.2 }));
    if (series.style === "handle") {
      return points.map(([cx, cy]) => make("svg:circle", { class: "moving-handle", fill: colour, stroke: colour, cx, cy, r: 7 }));
    }
    if (series.style === "circle") {
      const { left, right, top, bottom } = frame.box;
      const circles = xs.map((x, i) => make("svg:circle", { class: "moving-line", stroke: colour, "stroke-dasharray": dashes.join(" "),
        cx: (x - frame.start[0]) * frame.wide, cy: bottom - top - (ys[i] - frame.start[1]) * frame.wide, r: tops[i] * frame.wide }));
      return [make("svg:svg", { x: left, y: top, width: right - left, height: bottom - top, overflow: "hidden" }, ...circles)]; // cut at the axes
    }
    if (series.style === "bars") {
      const wide = 0.8 * (frame.x(xs[1]) - frame.x(xs[0]));
      const foot = frame.y(0);
      return points.map(([x, y]) => make("svg:rect", { fill: colour, x: x - wide / 2, width: wide, y: Math.min(y, foot), height: Math.abs(foot - y) }));
    }
    if (series.style === "band") {
      const back = xs.map((x, i) => [frame.x(x).toFixed(1), frame.y(tops[i]).toFixed(1)]).reverse();
      return [make("svg:polygon", { fill: colour, "fill-opacity": 0.2, points: points.concat(back).join(" ") })];
    }
    return [line(points, colour, dashes)];
  }

  const line = (points, stroke, dashes) =>
    make("svg:polyline", { class: "moving-line", stroke, "stroke-dasharray": dashes.join(" "), points: points.join(" ") });

  /** Labels, moved apart so that none covers another: down, and up again from the lower edge. */
  function moveApart(labels, top, bottom) {
    const meet = (a, b) => a.x <= b.x + b.wide && b.x <= a.x + a.wide;
    const before = (all, i) => all.slice(0, i).filter((other) => meet(all[i], other)).map((other) => other.y);
    labels.sort((a, b) => a.y - b.y);
    labels.forEach((label, i) => { label.y = Math.max(label.y, top, ...before(labels, i).map((y) => y + GAP)); });
    labels.reverse();
    labels.forEach((label, i) => { label.y = Math.min(label.y, bottom, ...before(labels, i).map((y) => y - GAP)); });
  }

  const standsAtEnd = (chart, series) => !chart.equal && series.label && series.at < 0;

  /** The room for labels beside the charts of a figure: it is one, so that they stand below one another. */
  const roomBeside = (charts) =>
    Math.max(0, ...charts.flatMap((chart) => chart.series.filter((series) => standsAtEnd(chart, series))).map(({ label }) => widthOf(label)));

  function draw(svg, chart, values, width, beside, sentence, strokes) {
    const named = chart.series.map((series, i) => ({ ...series, values: values[i] })).filter((series) => series.label);
    const frame = frameOf(chart, width, chart.equal ? 0 : beside);
    svg.setAttribute("viewBox", `0 0 ${width} ${frame.height}`);
    svg.setAttribute("width", width);
    svg.setAttribute("height", frame.height);
    const labels = named.map((series) => {
      const [xs, ys] = series.values;
      const at = series.at < 0 ? xs.length + series.at : series.at;
      return { ...series, x: frame.x(xs[at]) + (series.style === "handle" ? 13 : 6), y: frame.y(ys[at]) + (standsAtEnd(chart, series) ? 4 : -6) };
    });
    for (const label of labels) {
      label.wide = widthOf(label.label);
      label.x = Math.min(label.x, width - label.wide - 4);
    }
    moveApart(labels, frame.box.top + 8, frame.box.bottom);
    svg.replaceChildren(
      make("svg:title", { id: `${svg.id}-title` }, chart.title),
      make("svg:desc", { id: `${svg.id}-desc` }, sentence),
      ...axesOf(chart, frame, width),
      ...chart.series.flatMap((series, i) => seriesOf(series, values[i], frame, strokes[series.method])),
      ...labels.map(({ method, label, x, y }) => make("svg:text", { class: "moving-label", fill: strokes[method][0], x, y }, label)),
    );
    return frame;
  }

  /** What the series of a number looks like, as its key. */
  function keyOf(style, [colour, dashes]) {
    if (!style) return "";
    const dots = style === "points" || style === "handle";
    const filled = { band: 0.3, bars: 1 }[style];
    const shape = dots ? make("svg:circle", { fill: colour, cx: 13, cy: 5, r: style === "points" ? 2.2 : 5 })
      : filled ? make("svg:rect", { fill: colour, "fill-opacity": filled, x: 1, width: 24, y: 0, height: 10 }) : line([[1, 5], [25, 5]], colour, dashes);
    return make("svg:svg", { class: "moving-sample", width: 26, height: 10, "aria-hidden": "true", focusable: "false" }, shape);
  }

  const MOST_BUTTONS = 4; // places of a choice: more make a slider

  /** What a reader moves: its label, its input or buttons, and what says its place. */
  function controlOf(slider, id, move) {
    const last = slider.texts.length - 1;
    if (last < MOST_BUTTONS) {
      const buttons = slider.texts.map((text, place) => {
        const input = make("input", { type: "radio", id: `${id}-${place}`, name: id, "data-name": slider.name, autocomplete: "off" });
        input.addEventListener("change", () => move(place));
        return { input, label: make("label", { for: input.id }, text) };
      });
      const row = make("div", { class: "moving-buttons" }, ...buttons.flatMap(({ input, label }) => [input, label]));
      const legend = make("span", { id: `${id}-label` }, slider.label);
      const field = make("div", { class: "moving-control", role: "radiogroup", "aria-labelledby": legend.id }, legend, row);
      return { field, show: (place) => { buttons[place].input.checked = true; } };
    }
    const input = make("input", { type: "range", id, min: 0, max: last, step: 1, autocomplete: "off", "data-name": slider.name });
    // an output is a live region by itself, but the slider says its value already
    const output = make("output", { for: id, "aria-live": "off" });
    input.addEventListener("input", () => move(Number(input.value)));
    const field = make("div", { class: "moving-control" }, make("label", { for: id }, slider.label), input, output);
    const show = (place) => {
      input.value = place;
      output.textContent = slider.texts[place];
      input.setAttribute("aria-valuetext", slider.texts[place]);
    };
    if (slider.plays) field.append(playerOf(input, last));
    return { field, show };
  }

  /** A button that goes through the places of a slider, from the first again after the last. */
  function playerOf(input, last) {
    const button = make("button", { type: "button", class: "moving-play" });
    let timer;
    const stop = () => { timer = clearInterval(timer); button.textContent = "▶ Play"; };
    const go = (place) => { input.value = place; input.dispatchEvent(new Event("input")); };
    button.addEventListener("click", () => {
      if (timer) return stop();
      button.textContent = "❚❚ Pause";
      if (Number(input.value) === last) go(0);
      timer = setInterval(() => {
        if (Number(input.value) < last) go(Number(input.value) + 1);
        else stop();
      }, Math.min(400, Math.max(50, 6000 / last)));
    });
    stop();
    return button;
  }

  /** Let a reader drag the handles of a chart: their sliders go to the place whose point is nearest. */
  function letDrag(svg, chart, sliders, places, moveTo) {
    const handles = chart.series.filter(({ style }) => style === "handle");
    const NEAR = 24;
    let held;

    /** The nearest place of a handle: how far it is away, and by which index in its table. */
    const nearest = (event, { values }, indices) => {
      const { left, top } = svg.getBoundingClientRect();
      const away = ([[x], [y]]) => Math.hypot(svg.frame.x(x) - event.clientX + left, svg.frame.y(y) - event.clientY + top);
      return indices.map((index) => [away(values[index]), index]).sort((a, b) => a[0] - b[0])[0];
    };
    svg.addEventListener("pointerdown", (event) => {
      held = handles.find((handle) => nearest(event, handle, [indexOf(handle, sliders, places)])[0] < NEAR);
      if (held) svg.setPointerCapture(event.pointerId);
    });
    svg.addEventListener("pointermove", (event) => {
      if (!held) return;
      let [, index] = nearest(event, held, [...held.values.keys()]);
      const there = {};
      for (const name of [...held.by].reverse()) {
        there[name] = index % sliders[name].texts.length;
        index = Math.floor(index / sliders[name].texts.length);
      }
      moveTo(there);
    });
    for (const end of ["pointerup", "pointercancel"]) svg.addEventListener(end, () => { held = undefined; });
  }

  /** What a goal says: where it is reached if it is. */
  function said(goal, sliders, places) {
    if (!found(goal, sliders, places)) return `Goal: ${goal.text}.`;
    const where = goal.by.map((name) => {
      const text = sliders[name].texts[places[name]];
      return text.includes("=") ? text : `${sliders[name].label} ${text}`;
    });
    return `✓ Reached: ${goal.text}, at ${where.join(", ")}.`;
  }

  /** Build a moving figure in its section; `root.moving` then has the places, and a function that moves them. */
  function build(root) {
    const content = read(root);
    const sliders = Object.fromEntries(content.sliders.map((slider) => [slider.name, slider]));
    const places = Object.fromEntries(content.sliders.map(({ name, start }) => [name, start]));
    const moveTo = (others) => { Object.assign(places, others); refresh(); };
    const controls = content.sliders.map((slider) => controlOf(slider, `${root.id}-${slider.name}`, (place) => moveTo({ [slider.name]: place })));
    const numbers = content.numbers.map(({ method, label, key }) => {
      const value = make("dd");
      return { value, row: make("div", {}, make("dt", {}, keyOf(key, content.strokes[method]), ` ${label}`), value) };
    });
    const goals = content.goals.map(() => make("p", { class: "moving-goal", "aria-live": "polite" }));
    const status = make("p", { class: "moving-status", role: "status", "aria-live": "polite" });
    const charts = content.charts.map((chart, i) => {
      const id = `${root.id}-chart-${i}`;
      const svg = make("svg:svg", { id, role: "img", "aria-labelledby": `${id}-title`, "aria-describedby": `${id}-desc` });
      if (chart.series.some(({ style }) => style === "handle")) letDrag(svg, chart, sliders, places, moveTo);
      return svg;
    });
    const holder = make("div", { class: "moving-charts" }, ...charts);
    let waiting = 0;

    function refresh(width = Math.floor(holder.clientWidth)) {
      content.sliders.forEach(({ name }, i) => controls[i].show(places[name]));
      content.numbers.forEach((number, i) => { numbers[i].value.textContent = found(number, sliders, places); });
      content.goals.forEach((goal, i) => {
        const text = said(goal, sliders, places);
        goals[i].classList.toggle("moving-reached", found(goal, sliders, places));
        if (goals[i].textContent !== text) goals[i].textContent = text;
      });
      const sentence = found(content.sentence, sliders, places);
      if (width > 0) {
        const beside = roomBeside(content.charts);
        content.charts.forEach((chart, i) => {
          charts[i].frame = draw(charts[i], chart, chart.series.map((series) => found(series, sliders, places)), width, beside, sentence, content.strokes);
        });
      }
      clearTimeout(waiting); // said once a slider rests
      waiting = setTimeout(() => { status.textContent = sentence; }, 300);
    }

    refresh(320); // all is drawn once before anything is changed
    root.moving = { places, moveTo };
    root.setAttribute("aria-label", content.title);
    root.setAttribute("role", "group");
    root.append(
      make("div", { class: "moving-controls" }, ...controls.map(({ field }) => field)), ...goals,
      make("dl", { class: "moving-numbers" }, ...numbers.map((number) => number.row)),
      holder, ...(controls.length ? [status] : []),
    );
    root.hidden = false;
    new ResizeObserver(() => refresh()).observe(holder); // which calls it at once
  }

  /** Build a moving figure and put it in the place of the still picture, which is there if that fails. */
  function start(root) {
    const picture = document.getElementById(root.dataset.figure);
    if (!picture) throw new Error(`The page has no figure ${root.dataset.figure}.`);
    build(root);
    const output = root.closest(".cell_output");
    picture.prepend(root);
    if (output && !output.contains(picture)) output.hidden = true; // an empty box is left
    picture.classList.add("moving-started");
  }

  /** Start each moving figure of the page; one that fails leaves its picture, and the others alone. */
  function startAll() {
    for (const root of document.querySelectorAll("section.moving")) {
      try {
        start(root);
      } catch (error) {
        console.error(`The figure ${root.id} does not move.`, error);
      }
    }
    document.documentElement.classList.remove("moving-starts");
  }

  document.documentElement.classList.add("moving-starts"); // still pictures are not fetched until then
  window.inswsnMoving = { build, start, read };
  if (document.readyState === "loading") document.addEventListener("DOMContentLoaded", startAll);
  else startAll();
})();
