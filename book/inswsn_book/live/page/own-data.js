/* A reader's own recording on the page of chapter 90: drop a CSV file, see what the filter finds.

   The page has an empty <section id="own-data" hidden data-example="…">. Where Python runs in the
   page, by window.inswsnLive, this script fills and shows it. The file is read here and given to
   Python in this browser; it is sent nowhere. Python computes and words everything
   (inswsn_book.live.own_data); this script draws. What comes from a file is set as text alone. */
"use strict";

(() => {
  if (window.inswsnOwnData) return; // included twice

  const LOOK = "inswsn_book.live.own_data:look";
  const SVG = "http://www.w3.org/2000/svg";
  const LARGEST = 50e6; // bytes: more lines than Python takes, and nothing to load into a page
  // name, label, unit and usual value: those of inswsn_book.live.own_data.FIGURES
  const FIGURES = [
    ["wsn_position_noise", "Noise of network positions", "m", 0.2],
    ["wsn_velocity_noise", "Noise of network velocities", "m/s", 0.1],
    ["acceleration_noise", "Error of INS acceleration", "m/s²", 0.05],
    ["initial_position_error", "First error of INS position", "m", 1],
    ["initial_velocity_error", "First error of INS velocity", "m/s", 0.1],
  ];
  // colours and dashes of the book: inswsn_lib.plotting.STROKES
  const STROKES = {
    ins: ["#c65200", ""], network: ["#007a5a", "2 3"], corrected: ["#0072b2", ""], nis: ["#0072b2", ""],
    x: ["#0072b2", ""], y: ["#c65200", "9 3"], v_x: ["#007a5a", "2 3"], v_y: ["#8f4676", "9 3 2 3"],
  };

  function make(name, attributes = {}, ...children) {
    const node = name.startsWith("svg:") ? document.createElementNS(SVG, name.slice(4)) : document.createElement(name);
    for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
    node.append(...children); // a string becomes text, never HTML
    return node;
  }

  // Axes -----------------------------------------------------------------------------------------

  /** Round numbers within two ends, some as many as asked for. */
  function ticksOf([low, high], count) {
    const rough = (high - low) / count;
    const power = 10 ** Math.floor(Math.log10(rough));
    const step = power * [1, 2, 5, 10].find((times) => times * power >= rough);
    const ticks = [];
    for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) ticks.push(k * step);
    const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
    return ticks.map((value) => [value, value.toFixed(Math.min(digits, 9)).replace("-", "−")]);
  }

  /** Powers of ten, between two of which the axis reaches: it has the exponents. */
  const powersOf = ([low, high]) =>
    ticksOf([low, high], Math.min(5, high - low)).map(([k]) => [k, String(Number((10 ** k).toPrecision(1)))]);

  const powersAround = ([low, high]) => [Math.floor(low), Math.ceil(high)];

  /** The least and the greatest number, a little apart. */
  function endsOf(...lists) {
    let [low, high] = [Infinity, -Infinity];
    for (const list of lists)
      for (const value of list)
        if (value !== null) [low, high] = [Math.min(low, value), Math.max(high, value)];
    if (!(low <= high)) return [0, 1];
    const room = 0.03 * (high - low) || Math.max(1e-6, 1e-6 * Math.abs(low));
    return [low - room, high + room];
  }

  /** The width of a text in the font of the charts. */
  function widthOf(text) {
    const pen = document.createElement("canvas").getContext("2d");
    pen.font = `13px ${getComputedStyle(document.body).fontFamily}`;
    return pen.measureText(text).width;
  }

  // Charts ---------------------------------------------------------------------------------------

  function frameOf(chart, width) {
    const yTicks = chart.log ? powersOf(chart.y.ends) : ticksOf(chart.y.ends, 4);
    const left = 28 + Math.max(...yTicks.map(([, text]) => widthOf(text)));
    const [x, y] = [chart.x.ends, chart.y.ends];
    let across = (width - left - 14) / (x[1] - x[0]);
    let tall = 190;
    let up = tall / (y[1] - y[0]);
    if (chart.equal) { // a metre is as long upwards as sideways
      across = up = Math.min(across, 340 / (y[1] - y[0]));
      tall = up * (y[1] - y[0]);
    }
    const box = { left, top: 26, right: left + across * (x[1] - x[0]), bottom: 26 + tall };
    const clamp = (value, [low, high]) => Math.min(Math.max(value, low), high);
    return {
      box, yTicks, height: box.bottom + 42,
      xTicks: ticksOf(x, Math.max(3, Math.floor((box.right - box.left) / 90))),
      x: (value) => box.left + (clamp(value, x) - x[0]) * across,
      y: (value) => box.bottom - (clamp(value, y) - y[0]) * up,
    };
  }

  function axesOf(chart, { box, xTicks, yTicks, x, y }) {
    const line = (x1, x2, y1, y2) => make("svg:line", { class: "own-data-grid", x1, x2, y1, y2 });
    const word = (text, attributes) => make("svg:text", attributes, text);
    const middle = (box.top + box.bottom) / 2;
    return [
      ...yTicks.map(([value]) => line(box.left, box.right, y(value), y(value))),
      ...xTicks.map(([value]) => line(x(value), x(value), box.top, box.bottom)),
      ...yTicks.map(([value, text]) => word(text, { x: box.left - 6, y: y(value) + 4, "text-anchor": "end" })),
      ...xTicks.map(([value, text]) => word(text, { x: x(value), y: box.bottom + 17, "text-anchor": "middle" })),
      word(chart.title, { class: "own-data-title", x: 2, y: 15 }),
      word(chart.x.label, { x: (box.left + box.right) / 2, y: box.bottom + 35, "text-anchor": "middle" }),
      word(chart.y.label, { x: 12, y: middle, transform: `rotate(-90 12 ${middle})`, "text-anchor": "middle" }),
    ];
  }

  /** The places of a series in the picture, in pieces between its gaps. */
  function piecesOf(xs, ys, frame) {
    const pieces = [[]];
    xs.forEach((x, i) => {
      if (x === null || ys[i] === null) pieces.push([]);
      else pieces.at(-1).push([frame.x(x).toFixed(1), frame.y(ys[i]).toFixed(1)]);
    });
    return pieces.filter((piece) => piece.length);
  }

  function seriesOf({ style, stroke, xs, ys, tops }, frame) {
    const pieces = piecesOf(xs, ys, frame);
    if (style === "band") {
      const back = piecesOf(xs, tops, frame).flat().reverse();
      return [make("svg:polygon", { class: "own-data-band", points: pieces.flat().concat(back).join(" ") })];
    }
    const [colour, dashes] = STROKES[stroke];
    if (style === "points") return pieces.flat().map(([cx, cy]) => make("svg:circle", { fill: colour, cx, cy, r: 2 }));
    return pieces.map((points) => make("svg:polyline", { class: "own-data-line", stroke: colour, "stroke-dasharray": dashes, points: points.join(" ") }));
  }

  function drawn(svg, chart, width) {
    const frame = frameOf(chart, width);
    const { box } = frame;
    for (const [key, value] of Object.entries({ viewBox: `0 0 ${width} ${frame.height}`, width, height: frame.height }))
      svg.setAttribute(key, value);
    const shades = (chart.shades ?? []).map(({ begins, lasts }) => make("svg:rect", {
      class: "own-data-outage", x: frame.x(begins), y: box.top, height: box.bottom - box.top,
      width: Math.max(1, frame.x(begins + lasts) - frame.x(begins)),
    }));
    svg.replaceChildren(
      make("svg:title", { id: `${svg.id}-title` }, chart.title),
      make("svg:desc", { id: `${svg.id}-desc` }, chart.says),
      ...shades, ...axesOf(chart, frame), ...chart.series.flatMap((series) => seriesOf(series, frame)),
    );
  }

  /** A key to the series: a short piece of each, and its name. */
  function keyOf(chart) {
    const sample = ({ style, stroke }) => {
      const place = { x: (x) => x, y: (y) => y };
      const xs = style === "points" ? [4, 13, 22] : [1, 25];
      const shape = { style, stroke, xs, ys: xs.map(() => style === "band" ? 1 : 5), tops: xs.map(() => 9) };
      return make("svg:svg", { width: 26, height: 10, "aria-hidden": "true", focusable: "false" }, ...seriesOf(shape, place));
    };
    const entries = chart.series.map((series) => make("li", {}, sample(series), ` ${series.label}`));
    return make("ul", { class: "own-data-key" }, ...entries);
  }

  /** The charts of what Python has found. */
  function chartsOf({ track, size, nis, white, outages }) {
    const seconds = "time since the first row (s)";
    const exponents = (values) => values.map((value) => (value > 0 ? Math.log10(value) : null));
    const [time, error, sigma] = [size[0], exponents(size[1]), exponents(size[2])];
    const tracks = [["ins", "INS alone", "line"], ["network", "network", "points"], ["corrected", "INS corrected", "line"]];
    const cap = 4 * Math.max(...nis.high);
    const ofWhat = nis.group === 1 ? "each fix" : `the mean of each ${nis.group} fixes`;
    const ends = endsOf(time);
    const charts = [
      {
        title: "The track", equal: true, says: "The track by the INS alone, by the network and by the corrected INS.",
        x: { label: "x (m)", ends: endsOf(...tracks.map(([name]) => track[name][0])) },
        y: { label: "y (m)", ends: endsOf(...tracks.map(([name]) => track[name][1])) },
        series: tracks.map(([stroke, label, style]) => ({ stroke, label, style, xs: track[stroke][0], ys: track[stroke][1] })),
      },
      {
        title: "Error of the INS", log: true, shades: outages,
        says: "The position error of the INS that the filter estimates, and the uncertainty that it states, against time; outages are shaded.",
        x: { label: seconds, ends }, y: { label: "position (m)", ends: powersAround(endsOf(error, sigma)) },
        series: [
          { stroke: "ins", label: "estimated error of the INS", xs: time, ys: error },
          { stroke: "corrected", label: "uncertainty (1 σ) that the filter states", xs: time, ys: sigma },
        ],
      },
      {
        title: "NIS of a component", shades: outages,
        says: `The normalised innovation squared of ${ofWhat}: ${(100 * nis.inside).toFixed(0)} % are in the band that holds 95 % if the noise figures fit. What is above the axis is drawn at its end.`,
        x: { label: seconds, ends }, y: { label: "NIS (1)", ends: [0, Math.min(cap, 1.05 * Math.max(...nis.value, ...nis.high))] },
        series: [
          { style: "band", stroke: "nis", label: "95 % by chi-square", xs: nis.time, ys: nis.low, tops: nis.high },
          { style: "points", stroke: "nis", label: `NIS, ${ofWhat}`, xs: nis.time, ys: nis.value },
        ],
      },
    ];
    const components = Object.entries(white.components);
    if (components.length && white.lags.length) {
      const band = [0.5, white.lags.length + 0.5];
      const limit = Math.min(1, white.bound);
      charts.push({
        title: "Are the innovations white?",
        says: "The autocorrelation of the innovations of each component; within the band each is by chance, but for one in a thousand.",
        x: { label: `lag (${white.interval.toPrecision(3)} s each)`, ends: band },
        y: { label: "autocorrelation (1)", ends: endsOf([-limit, limit], ...components.map(([, values]) => values)) },
        series: [
          { style: "band", stroke: "nis", label: "by chance", xs: band, ys: [-limit, -limit], tops: [limit, limit] },
          ...components.map(([stroke, ys]) => ({ stroke, label: stroke.replace("v_", "velocity "), xs: white.lags, ys })),
        ],
      });
    }
    return charts;
  }

  // Tables and text ------------------------------------------------------------------------------

  function tableOf(caption, header, rows) {
    const cell = (text, i) => (i ? make("td", {}, text) : make("th", { scope: "row" }, text));
    return make("table", { class: "table own-data-table" },
      make("caption", {}, caption),
      make("thead", {}, make("tr", {}, ...header.map((text) => make("th", { scope: "col" }, text)))),
      make("tbody", {}, ...rows.map((row) => make("tr", {}, ...row.map(cell)))));
  }

  const fixed = (value, digits) => (value === null ? "–" : value.toFixed(digits));

  function tablesOf({ outages, errors }) {
    const tables = [];
    if (outages.length)
      tables.push(tableOf("Outages of the network.", ["begins at (s)", "lasts (s)"],
        outages.map(({ begins, lasts }) => [begins.toFixed(1), lasts.toFixed(1)])));
    if (errors.length)
      tables.push(tableOf("Root mean square errors by the reference of the file.", ["track", "when", "position (m)", "velocity (m/s)"],
        errors.map((row) => [row.track, row.when, fixed(row.position, 3), fixed(row.velocity, 3)])));
    return tables;
  }

  let address = ""; // of the file for download

  function downloadOf({ csv, name }) {
    URL.revokeObjectURL(address);
    address = URL.createObjectURL(new Blob([csv], { type: "text/csv" }));
    const file = `${name.replace(/\.[^.]*$/, "")}-corrected.csv`;
    return make("p", {}, make("a", { class: "btn btn-sm own-data-button", href: address, download: file }, "Download the corrected track (CSV)"));
  }

  /** Put what was found into its place, and draw it anew whenever its width changes. */
  function show(place, found) {
    const charts = chartsOf(found).map((chart, i) => {
      const id = `own-data-chart-${i}`;
      const svg = make("svg:svg", { id, role: "img", "aria-labelledby": `${id}-title`, "aria-describedby": `${id}-desc` });
      return { chart, svg, figure: make("div", { class: "own-data-chart" }, svg, keyOf(chart)) };
    });
    place.replaceChildren(
      make("h3", {}, `What the filter finds in ${found.name}`),
      make("ul", {}, ...found.sentences.map((text) => make("li", {}, text))),
      downloadOf(found), ...charts.map(({ figure }) => figure), ...tablesOf(found),
    );
    place.hidden = false;
    const draw = () => {
      const width = Math.floor(place.clientWidth);
      if (width > 0) for (const { chart, svg } of charts) drawn(svg, chart, Math.min(width, 736));
    };
    draw();
    show.observer?.disconnect();
    show.observer = new ResizeObserver(draw);
    show.observer.observe(place);
  }

  // What a reader does ---------------------------------------------------------------------------

  function figureField([name, label, unit, usual]) {
    const input = make("input", { type: "number", id: `own-data-${name}`, min: 0, step: "any", value: usual, autocomplete: "off" });
    return { name, input, field: make("div", {}, make("label", { for: input.id }, `${label} (${unit})`), input) };
  }

  function start(root) {
    if (root.childElementCount) return; // started before
    const button = (text) => make("button", { type: "button", class: "btn btn-sm own-data-button" }, text);
    const file = make("input", { type: "file", id: "own-data-file", accept: ".csv,.txt,.tsv,text/csv" });
    const example = button("Show an example");
    const again = button("Compute again");
    const fields = FIGURES.map(figureField);
    const status = make("p", { role: "status", class: "own-data-status" });
    const alert = make("p", { role: "alert", class: "own-data-alert" });
    const results = make("div", { class: "own-data-results", hidden: "" });
    let [recording, turn] = [null, 0]; // what was read last, and how often something was asked for

    /** Say what goes on, and show what a promise brings, unless something else was asked for since. */
    async function after(said, work) {
      const mine = ++turn;
      status.textContent = said;
      alert.textContent = "";
      results.hidden = true;
      root.setAttribute("aria-busy", "true");
      try {
        const found = await work();
        if (mine !== turn) return;
        show(results, found);
        status.textContent = `Done: what was found in ${found.name} is below.`;
      } catch (error) {
        if (mine !== turn) return;
        status.textContent = "";
        alert.textContent = error.message;
      } finally {
        if (mine === turn) root.removeAttribute("aria-busy");
      }
    }

    function compute() {
      const figures = fields.map(({ name, input }) => [name, input.value === "" ? null : Number(input.value)]);
      return window.inswsnLive.call(LOOK, [recording.text, { name: recording.name, ...Object.fromEntries(figures) }]);
    }

    const computing = (name) => `Computing ${name}. The first time, Python is loaded into this page, which takes some seconds.`;

    /** Read what has a name and bytes, and compute. */
    function take(name, size, bytes) {
      recording = null;
      again.disabled = true;
      return after(computing(name), async () => {
        if (size > LARGEST) throw new Error(`${name} has ${(size / 1e6).toFixed(0)} MB; this page takes ${LARGEST / 1e6} MB at most.`);
        const read = { name, text: textOf(name, await bytes()) };
        recording = read;
        again.disabled = false;
        return compute();
      });
    }

    const takeFile = (chosen) => chosen && take(chosen.name, chosen.size, () => chosen.arrayBuffer());
    const drop = make("div", { class: "own-data-drop" },
      make("label", { for: file.id }, "Choose a CSV file of the form below, or drop one here"), file, example);
    file.addEventListener("change", () => takeFile(file.files[0]));
    file.addEventListener("click", () => { file.value = ""; }); // the same file may be chosen again
    example.addEventListener("click", () => take("ins-wsn.csv", 0, async () => {
      const answer = await fetch(root.dataset.example);
      if (!answer.ok) throw new Error("The example is not on this site.");
      return answer.arrayBuffer();
    }));
    again.disabled = true;
    again.addEventListener("click", () => after(computing(recording.name), compute));
    for (const kind of ["dragenter", "dragover"])
      root.addEventListener(kind, (event) => { event.preventDefault(); drop.classList.add("own-data-over"); });
    for (const kind of ["dragleave", "drop"])
      root.addEventListener(kind, () => drop.classList.remove("own-data-over"));
    root.addEventListener("drop", (event) => { event.preventDefault(); takeFile(event.dataTransfer.files[0]); });

    root.append(
      make("h2", { id: "own-data-heading" }, "Your file in this page"),
      make("p", {}, "Python runs in this page and filters your recording as this chapter does. The file does not leave your machine."),
      drop,
      make("details", {}, make("summary", {}, "Noise figures of the filter (standard deviations)"),
        make("div", { class: "own-data-figures" }, ...fields.map(({ field }) => field), again)),
      status, alert, results,
    );
    root.setAttribute("aria-labelledby", "own-data-heading");
    root.hidden = false;
  }

  function textOf(name, bytes) {
    try {
      return new TextDecoder("utf-8", { fatal: true }).decode(bytes);
    } catch {
      throw new Error(`${name} is not a CSV file: it is not UTF-8.`);
    }
  }

  /** Start where the page has the section and Python; what brings Python later calls this again. */
  function startHere() {
    const root = document.getElementById("own-data");
    if (root && window.inswsnLive) start(root);
  }

  window.inswsnOwnData = { start: startHere };
  if (document.readyState === "loading") document.addEventListener("DOMContentLoaded", startHere);
  else startHere();
})();
