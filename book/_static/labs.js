/* The labs: charts in a page that a reader moves by sliders, without a server.

   A cell shows a lab by inswsn_book.show.show_lab: a hidden <section class="lab"> with its data as
   JSON. This script builds controls, a table and charts in it and puts it in the place of the still
   picture of the figure that it names. Without this script, and in print, the picture stays.

   The numerics are pure functions on arrays, exported as window.inswsnLabs; the tests compare them
   with the Python library. Vectors are arrays, matrices are arrays of rows. */
"use strict";

(() => {
  if (window.inswsnLabs) return; // included twice

  // ---------------------------------------------------------------- numerics

  const range = (count) => Array.from({ length: count }, (_, i) => i);
  const product = (A, B) => A.map((row) => B[0].map((_, j) => row.reduce((sum, a, k) => sum + a * B[k][j], 0)));
  const transposed = (A) => A[0].map((_, j) => A.map((row) => row[j]));
  const added = (A, B, sign = 1) => A.map((row, i) => row.map((a, j) => a + sign * B[i][j]));
  const diagonal = (values) => values.map((value, i) => values.map((_, j) => (i === j ? value : 0)));
  const meanAbsolute = (values) => values.reduce((sum, v) => sum + Math.abs(v), 0) / values.length;

  /** The inverse of a matrix of two rows and columns. */
  function inverse2([[a, b], [c, d]]) {
    const det = a * d - b * c;
    return [[d / det, -b / det], [-c / det, a / det]];
  }

  /** The lower Cholesky factor of a symmetric, positive definite matrix. */
  function cholesky(H) {
    const n = H.length;
    const L = range(n).map(() => new Float64Array(n));
    for (let j = 0; j < n; j++) {
      for (let i = j; i < n; i++) {
        let sum = H[i][j];
        for (let k = 0; k < j; k++) sum -= L[i][k] * L[j][k];
        if (i > j) L[i][j] = sum / L[j][j];
        else if (sum > 0) L[j][j] = Math.sqrt(sum);
        else throw new Error("The matrix is not positive definite.");
      }
    }
    return L;
  }

  /** The solution x of L L' x = b. */
  function solveFactored(L, b) {
    const x = Float64Array.from(b);
    for (let i = 0; i < x.length; i++) {
      for (let k = 0; k < i; k++) x[i] -= L[i][k] * x[k];
      x[i] /= L[i][i];
    }
    for (let i = x.length - 1; i >= 0; i--) {
      for (let k = i + 1; k < x.length; k++) x[i] -= L[k][i] * x[k];
      x[i] /= L[i][i];
    }
    return Array.from(x);
  }

  /** The gains of a Kalman filter of two states that are both measured, C = I; Joseph's form. */
  function kalmanGains(A, Q, R, P0, steps) {
    let P = P0;
    return range(steps).map(() => {
      const K = product(P, inverse2(added(P, R)));
      const keep = added(diagonal([1, 1]), K, -1);
      const after = added(product(product(keep, P), transposed(keep)), product(product(K, R), transposed(K)));
      P = added(product(product(A, after), transposed(A)), Q);
      return K;
    });
  }

  /** The filtered states: x- + K_k (y_k - x-), where x- is A times the state before. */
  function runFilter(A, gains, y, start) {
    let before = start;
    return y.map((measured, k) => {
      const news = measured.map((value, i) => value - before[i]);
      const state = before.map((value, i) => value + gains[k][i].reduce((sum, g, j) => sum + g * news[j], 0));
      before = A.map((row) => row.reduce((sum, a, j) => sum + a * state[j], 0));
      return state;
    });
  }

  /** exp(-|x - z|^2 / 2 sigma^2) of every row of X with every row of Z. */
  function radialKernel(X, Z, sigma) {
    return X.map((x) => Z.map((z) => {
      let square = 0;
      for (let i = 0; i < x.length; i++) square += (x[i] - z[i]) ** 2;
      return Math.exp((square * -0.5) / sigma ** 2);
    }));
  }

  /** The least-squares support vector machine of P1 (3.8): H u = 1, H v = y, b = 1'v / 1'u, alpha = v - u b. */
  function fitLssvm(X, Y, sigma, eta) {
    const H = radialKernel(X, X, sigma);
    H.forEach((row, i) => { row[i] += 1 / eta; });
    const L = cholesky(H);
    const total = (values) => values.reduce((sum, v) => sum + v, 0);
    const u = solveFactored(L, X.map(() => 1));
    const outputs = transposed(Y).map((y) => {
      const v = solveFactored(L, y);
      const bias = total(v) / total(u);
      return { bias, alpha: v.map((value, i) => value - u[i] * bias) };
    });
    return { X, sigma, alpha: outputs.map((o) => o.alpha), bias: outputs.map((o) => o.bias) };
  }

  /** What such a machine says of inputs Z, (rows, outputs). */
  function predictLssvm(machine, Z) {
    return radialKernel(Z, machine.X, machine.sigma).map((row) =>
      machine.alpha.map((alpha, o) => machine.bias[o] + row.reduce((sum, k, i) => sum + k * alpha[i], 0)));
  }

  /** Inputs or targets in other units, and back. */
  const scaledBy = (rows, scale) => rows.map((row) => row.map((v, i) => (v - scale.middle[i]) / scale.size[i]));
  const unscaled = (rows, scale) => rows.map((row) => row.map((v, i) => v * scale.size[i] + scale.middle[i]));

  /** A network of one hidden layer, W2 tanh(W1 x + b1) + b2, its parameters in one flat array. */
  function forward(weights, shape, rows) {
    const { inputs, hidden, outputs } = shape;
    const [b1, W2, b2] = [hidden * inputs, hidden * inputs + hidden, hidden * inputs + hidden + outputs * hidden];
    return rows.map((x) => {
      const bent = range(hidden).map((h) => Math.tanh(x.reduce((sum, v, i) => sum + weights[h * inputs + i] * v, weights[b1 + h])));
      return range(outputs).map((o) => bent.reduce((sum, v, h) => sum + weights[W2 + o * hidden + h] * v, weights[b2 + o]));
    });
  }

  const median = (values) => {
    const sorted = [...values].sort((a, b) => a - b);
    const half = sorted.length >> 1;
    return sorted.length % 2 ? sorted[half] : (sorted[half - 1] + sorted[half]) / 2;
  };

  // ---------------------------------------------------------------- words and numbers

  /** Three digits that count. */
  const shown = (value) => {
    const text = String(Number(value.toPrecision(3)));
    if (text.includes("e") || value === 0) return text;
    if (Math.abs(value) >= 1000) return plain(value);
    const digits = Math.max(0, 2 - Math.floor(Math.log10(Math.abs(Number(text)))));
    return Number(text).toFixed(digits);
  };
  /** A part of a whole in percent; of ten times and more, how many times. */
  const share = (part, whole) =>
    (part < 10 * whole ? `${shown((100 * part) / whole)}\u00a0% of` : `${plain(part / whole)} times`);
  /** Three digits, without noughts at the end; thousands are parted by a comma, as in the text. */
  const PLAIN = new Intl.NumberFormat("en-GB", { maximumSignificantDigits: 3 });
  const plain = (value) => PLAIN.format(value);

  const capital = (text) => text[0].toUpperCase() + text.slice(1);

  const sliderValue = (slider, place) => (slider.log ? 10 ** place : place);
  /** What a slider says, as its output and to a screen reader: the number and its unit. */
  const sliderText = (slider, place, unit) => [plain(sliderValue(slider, place)), unit].filter(Boolean).join(" ");
  const listed = (words) => (words.length > 1 ? `${words.slice(0, -1).join(", ")} and ${words.at(-1)}` : words.join(""));
  /** The ends and the least of a line over a slider, in words; all the places are powers of ten. */
  function course(name, values, all, unit) {
    const at = values.indexOf(Math.min(...values));
    return `${name}: ${shown(values[0])} m at ${plain(10 ** all[0])} ${unit}, least ${shown(values[at])} m at ${plain(10 ** all[at])}, ${shown(values.at(-1))} m at ${plain(10 ** all.at(-1))}`;
  }
  /** All the places of a slider. */
  const places = (slider) => range(Math.round((slider.high - slider.low) / slider.step) + 1).map((i) => slider.low + i * slider.step);

  // ---------------------------------------------------------------- what each lab computes

  const memory = (make) => {
    const kept = new Map();
    return (key, ...more) => {
      if (!kept.has(key)) kept.set(key, make(key, ...more));
      return kept.get(key);
    };
  };

  /** P1's error model on one axis: Kalman, H-infinity and constant-gain filter, and the network. */
  function gainLab(data, sliders) {
    const all = places(sliders.ratio);
    const prepared = memory((name) => {
      const run = data.runs[name];
      const A = [[1, run.period], [0, 1]];
      const y = added(run.ins, run.network, -1);
      return { ...run, A, y, R: diagonal(run.noise.measurement.map((s) => s * s)) };
    });
    const errors = (run, gains, start) => added(run.ins, runFilter(run.A, gains, run.y, start), -1);
    const means = (rows) => transposed(rows).map(meanAbsolute);

    function kalman(run, place) {
      const Q = diagonal(run.noise.process.map((s) => 10 ** place * s * s));
      const gains = kalmanGains(run.A, Q, run.R, diagonal([data.initial, data.initial]), run.y.length);
      return errors(run, gains, [0, 0]);
    }
    function hinfinity(run, place) {
      const step = Math.round((place - sliders.ratio.low) / sliders.ratio.step);
      // the design is B_f of x_{k+1} = A x_k + B_f (y_k - x_k); filtered its gain is A^-1 B_f
      const gain = product(inverse2(run.A), run.designs[step]);
      return errors(run, run.y.map(() => gain), run.y[0]);
    }
    // what a slider says of itself, where number and unit do not do
    const told = {
      ratio: (state) => (Math.abs(state.ratio) < 1e-9 ? "the matched Q" : `${plain(10 ** state.ratio)} times the matched Q`),
    };
    const constant = (run, g) => errors(run, run.y.map(() => diagonal([g, g])), run.y[0]);
    const sweep = memory((name) => {
      const run = prepared(name);
      return [kalman, hinfinity].map((method) => all.map((place) => means(method(run, place))[0]));
    });

    function compute(state) {
      const run = prepared(state.run);
      const found = {
        kf: kalman(run, state.ratio),
        hf: hinfinity(run, state.ratio),
        constant: constant(run, state.gain),
        network: run.network,
      };
      return { errors: found, means: Object.fromEntries(Object.entries(found).map(([key, rows]) => [key, means(rows)])) };
    }

    function view(state, choices) {
      const { errors: found, means: m } = compute(state);
      const run = data.runs[state.run];
      const time = run.ins.map((_, k) => k * run.period);
      const names = { kf: "KF", hf: "HF", constant: `g = ${plain(state.gain)}`, network: "network" };
      const long = {
        kf: "Kalman filter (KF)", hf: "H-infinity filter (HF), exact inequality",
        constant: `constant gain g = ${plain(state.gain)}`, network: "network; published HF, filtered",
      };
      // what is drawn first is widest and least dashed, so that it shows below what lies on it
      const order = ["kf", "hf", "constant", "network"];
      const lines = (i) => order.map((key) => ({ key, name: names[key], y: found[key].map((row) => row[i]) }));
      const meeting = coinciding(order.map((key) => ({ name: names[key], y: found[key].map((row) => row[0]) })));
      const numbers = (i, unit) => order.map((key) => `${names[key]} ${shown(m[key][i])} ${unit}`).join(", ");
      const flat = (key) => ({ key, name: names[key], y: all.map(() => m[key][0]) });
      const [kf, hf] = sweep(state.run);
      const setting = `${choices.run}, ${told.ratio(state)}, g = ${plain(state.gain)}`;
      return {
        rows: order.map((key) => ({ key, name: long[key], values: m[key] })),
        columns: ["position, m", "velocity, m/s"],
        caption: `Mean absolute error over the area: ${setting}`,
        sentence: `${capital(setting)}. In position the Kalman filter has ${share(m.kf[0], m.network[0])} the network's error, the H-infinity filter ${share(m.hf[0], m.network[0])} it, the constant gain ${share(m.constant[0], m.network[0])} it.${meeting}`,
        setting,
        charts: [
          { title: "Position error", unit: "m", x: time, xLabel: "time in the area (s)", lines: lines(0), ...data.axes.position[state.run], description: `${capital(setting)}. Mean absolute position errors: ${numbers(0, "m")}.` },
          { title: "Velocity error", unit: "m/s", x: time, xLabel: "time in the area (s)", lines: lines(1), ...data.axes.velocity[state.run], description: `${capital(setting)}. Mean absolute velocity errors: ${numbers(1, "m/s")}.` },
          {
            title: "Mean absolute position error against what the filters are told", unit: "m", x: all, xLog: true, xLabel: "assumed over matched Q", mark: state.ratio,
            lines: [{ key: "kf", name: "KF", y: kf }, { key: "hf", name: "HF", y: hf }, flat("constant"), flat("network")], ...data.axes.mean[state.run],
            description: `${capital(setting)}. Mean absolute position errors now: ${numbers(0, "m")}. Over the slider, ${course("KF", kf, all, "times the matched Q")}; ${course("HF", hf, all, "times")}.`,
          },
        ],
      };
    }
    return { compute, view, told };
  }

  /** Which lines lie on one another: their mean distance is below 2 % of the larger mean. */
  function coinciding(lines) {
    const close = (a, b) => {
      const apart = meanAbsolute(a.y.map((value, k) => value - b.y[k]));
      return apart < 0.02 * Math.max(meanAbsolute(a.y), meanAbsolute(b.y));
    };
    const pairs = lines.flatMap((a, i) => lines.slice(i + 1).filter((b) => close(a, b)).map((b) => [a.name, b.name]));
    if (!pairs.length) return "";
    return ` Lines that coincide: ${pairs.map(listed).join("; ")}.`;
  }

  /** An LS-SVM and networks that correct the INS in an outage. */
  function kernelLab(data, sliders) {
    const all = places(sliders.width);
    const prepared = memory((key) => {
      const [area, input] = key.split(" ");
      const half = data.areas[area];
      const source = { time: half.time.map((t) => [t]), motion: half.motion, oracle: half.ins }[input];
      const inputs = scaledBy(source, half.scales[input]);
      const learners = half.networks[input];
      const network = learners.weights.map((weights) =>
        unscaled(forward(weights, learners.shape, scaledBy(inputs, learners.inputs)), learners.targets));
      return { half, inputs, network: network.map((rows) => added(half.ins, rows, -1)) };
    });
    const machines = memory((key) => {
      const [area, input, eta, place] = key.split(" ");
      const { half, inputs } = prepared(`${area} ${input}`);
      const machine = fitLssvm(inputs.slice(0, half.targets.length), half.targets, 10 ** Number(place), 10 ** Number(eta));
      return added(half.ins, predictLssvm(machine, inputs), -1);
    });
    const told = {
      length: (state) => {
        const seconds = plain(state.length * data.areas[state.area].period);
        return `${plain(state.length)} ${state.length === 1 ? "sample" : "samples"}, ${seconds} s`;
      },
    };
    const left = (state, place) => machines([state.area, state.input, state.eta, place].join(" "));

    function compute(state) {
      const { half, network } = prepared(`${state.area} ${state.input}`);
      const from = half.targets.length;
      const mean = (rows, i) => meanAbsolute(rows.slice(from, from + state.length).map((row) => row[i]));
      // position and velocity of the axis stand two columns apart
      const parts = [Number(state.axis), Number(state.axis) + 2];
      const lssvm = left(state, state.width);
      const each = network.map((rows) => parts.map((i) => mean(rows, i)));
      return {
        parts,
        errors: { ins: half.ins, lssvm, network },
        means: { ins: parts.map((i) => mean(half.ins, i)), lssvm: parts.map((i) => mean(lssvm, i)), bp: [0, 1].map((i) => median(each.map((m) => m[i]))) },
        spread: [0, 1].map((i) => [Math.min(...each.map((m) => m[i])), Math.max(...each.map((m) => m[i]))]),
        sweep: () => all.map((place) => mean(left(state, place), parts[0])),
      };
    }

    function view(state, choices) {
      const found = compute(state);
      const { half } = prepared(`${state.area} ${state.input}`);
      const from = half.targets.length;
      const end = from + state.length;
      const { time } = half; // the whole outage, so that the axis stays where it is
      const cut = (rows, i) => rows.slice(0, end).map((row) => row[i]);
      const lines = (i) => [
        { key: "ins", name: "INS", y: cut(found.errors.ins, i) },
        ...found.errors.network.map((rows, n) => ({ key: "bp", name: "", thin: true, y: cut(rows, i) })),
        { key: "lssvm", name: "LS-SVM", y: cut(found.errors.lssvm, i) },
      ];
      // one name for all the networks, where their lines have their median at the end
      const networks = (i) => [{ key: "bp", text: `BP, ${found.errors.network.length} networks`, at: end - 1, y: median(found.errors.network.map((rows) => rows[end - 1][i])) }];
      const m = found.means;
      const sweep = found.sweep();
      const unit = sliders.width.units[state.input];
      const setting = `${choices.area}, ${choices.axis}, input ${choices.input}, width ${plain(10 ** state.width)} ${unit}, outage of ${told.length(state)}`;
      const words = (i, u) => `INS ${shown(m.ins[i])} ${u}, LS-SVM ${shown(m.lssvm[i])} ${u}, networks ${shown(m.bp[i])} ${u} (${shown(found.spread[i][0])} to ${shown(found.spread[i][1])})`;
      const outage = { from: half.time[from], to: half.time[end - 1], label: "outage" };
      return {
        rows: [
          { key: "lssvm", name: "LS-SVM", values: m.lssvm },
          { key: "bp", name: `BP, median of ${half.networks[state.input].weights.length} networks`, values: m.bp, spread: found.spread },
          { key: "ins", name: "INS alone", values: m.ins },
        ],
        columns: ["position, m", "velocity, m/s"],
        caption: `Mean absolute error left in the outage: ${setting}`,
        sentence: `${capital(setting)}. In position the LS-SVM leaves ${share(m.lssvm[0], m.ins[0])} the error of the INS, the networks ${share(m.bp[0], m.ins[0])} it in the median.`,
        setting,
        charts: [
          { title: "Position error that is left", unit: "m", x: time, xLabel: "time since the area began (s)", lines: lines(found.parts[0]), labels: networks(found.parts[0]), shade: outage, ...data.axes.position[state.area], description: `${capital(setting)}. In the outage: ${words(0, "m")}.` },
          { title: "Velocity error that is left", unit: "m/s", x: time, xLabel: "time since the area began (s)", lines: lines(found.parts[1]), labels: networks(found.parts[1]), shade: outage, ...data.axes.velocity[state.area], description: `${capital(setting)}. In the outage: ${words(1, "m/s")}.` },
          {
            title: "Mean absolute position error in the outage against the kernel width", unit: "m", x: all, xLog: true, xLabel: `kernel width (${unit})`, mark: state.width,
            lines: [
              { key: "ins", name: "INS", y: all.map(() => m.ins[0]) },
              { key: "bp", name: "BP, median", y: all.map(() => m.bp[0]) },
              { key: "lssvm", name: "LS-SVM", y: sweep },
            ],
            ...data.axes.mean[state.area],
            description: `${capital(setting)}. Mean absolute position errors now: ${words(0, "m")}. Over the width, ${course("LS-SVM", sweep, all, unit)}.`,
          },
        ],
      };
    }
    return { compute, view, told };
  }

  const LABS = { gain: gainLab, kernel: kernelLab };

  // ---------------------------------------------------------------- drawing

  const SVG = "http://www.w3.org/2000/svg";

  function make(name, attributes = {}, ...children) {
    const node = name.startsWith("svg:") ? document.createElementNS(SVG, name.slice(4)) : document.createElement(name);
    for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
    node.append(...children);
    return node;
  }

  /** Places on an axis for values: linear, logarithmic, or linear near zero and logarithmic beyond. */
  function scaleOf(kind, low, high, from, to, linear = 1) {
    const bend = { linear: (v) => v, log: (v) => Math.log10(v), asinh: (v) => Math.asinh(v / linear) }[kind];
    const [a, b] = [bend(low), bend(high)];
    return (value) => {
      const share = (bend(Math.min(Math.max(value, low), high)) - a) / (b - a);
      return from + share * (to - from);
    };
  }

  const RAISED = { "-": "⁻", 0: "⁰", 1: "¹", 2: "²", 3: "³", 4: "⁴", 5: "⁵", 6: "⁶", 7: "⁷", 8: "⁸", 9: "⁹" };
  const power = (exponent) => (exponent === 0 ? "1" : `10${[...String(exponent)].map((c) => RAISED[c]).join("")}`);

  function ticksOf(chart, width) {
    if (chart.xLog) {
      const decades = Math.round(chart.x.at(-1) - chart.x[0]);
      const every = width / decades < 36 ? 2 : 1;
      return range(Math.floor(decades / every) + 1)
        .map((i) => Math.round(chart.x[0]) + i * every)
        .map((v) => [v, power(v)]);
    }
    const span = chart.x.at(-1) - chart.x[0];
    const step = [1, 2, 5, 10, 20].find((s) => span / s <= width / 40) ?? 50;
    return range(Math.floor(span / step) + 1).map((i) => [i * step, String(i * step)]);
  }

  /** A label in rows: a long one is broken at its last space, which is kept. */
  const twoRows = (text) => (text.length > 10 ? [text.slice(0, text.lastIndexOf(" ") + 1), text.slice(text.lastIndexOf(" ") + 1)] : [text]);

  /** Labels at the ends of lines, moved apart so that none covers another. */
  function spreadOut(labels, gap, top, bottom) {
    const sorted = labels.sort((a, b) => a.y - b.y);
    let free = top;
    for (const label of sorted) {
      label.y = Math.max(label.y, free);
      free = label.y + gap * label.rows.length;
    }
    let limit = bottom + gap;
    for (const label of sorted.slice().reverse()) {
      label.y = Math.min(label.y, limit - gap * label.rows.length);
      limit = label.y;
    }
    return sorted;
  }

  /** The width of a label in the font of the page (labs.css says the rest): fonts differ by a third. */
  function widthOf(text) {
    const pen = document.createElement("canvas").getContext("2d");
    pen.font = `600 12px ${getComputedStyle(document.body).fontFamily}`;
    return pen.measureText(text.trim()).width;
  }

  function drawChart(svg, chart, width) {
    const height = 240;
    const labels = chart.lines.filter((line) => line.name)
      .map((line) => ({ key: line.key, text: line.name, at: line.y.length - 1, y: line.y.at(-1) }))
      .concat(chart.labels ?? [])
      .map((label) => ({ ...label, rows: twoRows(label.text) }));
    const longest = Math.max(...labels.flatMap((label) => label.rows.map(widthOf)));
    const box = { left: 46, right: width - 10 - longest, top: 26, bottom: height - 38 };
    const x = scaleOf("linear", chart.x[0], chart.x.at(-1), box.left, box.right);
    const y = scaleOf(chart.scale, chart.low, chart.high, box.bottom, box.top, chart.linear);
    svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
    svg.setAttribute("width", width);
    svg.setAttribute("height", height);
    const title = make("svg:title", { id: `${svg.id}-title` }, chart.title);
    const description = make("svg:desc", { id: `${svg.id}-desc` }, chart.description);
    const parts = [title, description];
    if (chart.shade) {
      const from = x(chart.shade.from);
      const to = Math.max(x(chart.shade.to), from + 2); // of one sample: a line
      parts.push(
        make("svg:rect", { class: "lab-shade", x: from, y: box.top, width: to - from, height: box.bottom - box.top }),
        make("svg:text", { x: from, y: box.top - 4 }, chart.shade.label),
      );
    }
    for (const value of chart.ticks) {
      const at = y(value);
      parts.push(
        make("svg:line", { class: "lab-grid", x1: box.left, x2: box.right, y1: at, y2: at }),
        make("svg:text", { x: box.left - 6, y: at + 4, "text-anchor": "end" }, plain(value).replace("-", "−")),
      );
    }
    for (const [value, text] of ticksOf(chart, box.right - box.left)) {
      const at = x(value);
      parts.push(
        make("svg:line", { class: "lab-grid", x1: at, x2: at, y1: box.top, y2: box.bottom }),
        make("svg:text", { x: at, y: box.bottom + 15, "text-anchor": "middle" }, text),
      );
    }
    parts.push(
      make("svg:line", { class: "lab-axis", x1: box.left, x2: box.right, y1: box.bottom, y2: box.bottom }),
      make("svg:line", { class: "lab-axis", x1: box.left, x2: box.left, y1: box.top, y2: box.bottom }),
      make("svg:text", { x: (box.left + box.right) / 2, y: height - 5, "text-anchor": "middle" }, chart.xLabel),
      make("svg:text", { x: 4, y: box.top - 10 }, `(${chart.unit})`),
    );
    for (const line of chart.lines) {
      const points = line.y.map((value, k) => `${x(chart.x[k]).toFixed(1)},${y(value).toFixed(1)}`).join(" ");
      parts.push(make("svg:polyline", { class: `lab-line lab-${line.key}${line.thin ? " lab-thin" : ""}`, points }));
    }
    if (chart.mark !== undefined) {
      const at = x(chart.mark);
      parts.push(make("svg:line", { class: "lab-mark", x1: at, x2: at, y1: box.top, y2: box.bottom }));
      const step = chart.x.findIndex((value) => Math.abs(value - chart.mark) < 1e-9);
      for (const line of chart.lines) {
        parts.push(make("svg:circle", { class: `lab-dot lab-${line.key}`, cx: at, cy: y(line.y[step]), r: 3.5 }));
      }
    }
    const placed = labels.map((label) => ({ ...label, x: x(chart.x[label.at]) + 5, y: y(label.y) + 4 }));
    for (const label of spreadOut(placed, 14, box.top + 4, box.bottom + 4)) {
      const rows = label.rows.map((row, i) => make("svg:tspan", { x: label.x, dy: i ? 13 : 0 }, row));
      parts.push(make("svg:text", { class: `lab-label lab-${label.key}`, x: label.x, y: label.y }, ...rows));
    }
    svg.replaceChildren(...parts);
  }

  /** A short piece of a line, as the table's key to the charts. */
  const sample = (key) =>
    make("svg:svg", { class: "lab-sample", width: 34, height: 10, "aria-hidden": "true", focusable: "false" },
      make("svg:line", { class: `lab-line lab-${key}`, x1: 1, x2: 33, y1: 5, y2: 5 }));

  // ---------------------------------------------------------------- the page

  function sliderField(slider, id, changed) {
    const input = make("input", { type: "range", id, min: slider.low, max: slider.high, step: slider.step, value: slider.start, autocomplete: "off", "data-name": slider.name });
    // an output is a live region by itself, but the slider says its value already
    const output = make("output", { for: id, "aria-live": "off" });
    input.addEventListener("input", changed);
    const field = make("div", { class: "lab-control" }, make("label", { for: id }, slider.label), input, output);
    return { field, input, output };
  }

  function choiceField(choice, id, changed) {
    const set = make("fieldset", { class: "lab-control", "data-name": choice.name }, make("legend", {}, choice.label));
    for (const [value, text] of choice.options) {
      const input = make("input", { type: "radio", id: `${id}-${value}`, name: id, value, autocomplete: "off" });
      input.checked = value === choice.start;
      input.addEventListener("change", changed);
      set.append(make("label", { for: input.id }, input, ` ${text}`));
    }
    return set;
  }

  function fillTable(table, view) {
    const head = make("tr", {}, make("th", { scope: "col" }, "method"), ...view.columns.map((text) => make("th", { scope: "col" }, text)));
    const rows = view.rows.map((row) => {
      const cells = row.values.map((value, i) => {
        const spread = row.spread ? ` (${shown(row.spread[i][0])} to ${shown(row.spread[i][1])})` : "";
        const cell = make("td", { "data-value": value }, shown(value) + spread);
        if (row.spread) [cell.dataset.low, cell.dataset.high] = row.spread[i];
        return cell;
      });
      return make("tr", { "data-key": row.key }, make("th", { scope: "row" }, sample(row.key), " ", row.name), ...cells);
    });
    table.replaceChildren(make("caption", {}, view.caption), make("thead", {}, head), make("tbody", {}, ...rows));
  }

  /** Build a lab in its section and put it in the place of the still picture. */
  function start(root) {
    const figure = document.getElementById(root.dataset.figure);
    if (!figure) throw new Error(`The page has no figure ${root.dataset.figure}.`);
    const { title, sliders, choices, data } = JSON.parse(root.querySelector("script").textContent);
    const named = Object.fromEntries(sliders.map((slider) => [slider.name, slider]));
    const lab = LABS[root.dataset.lab](data, named);
    const fields = sliders.map((slider) => sliderField(slider, `${root.id}-${slider.name}`, () => refresh()));
    const sets = choices.map((choice) => choiceField(choice, `${root.id}-${choice.name}`, () => refresh()));
    const reset = make("button", { type: "button", class: "lab-reset" }, "Reset");
    const table = make("table", { class: "lab-numbers" });
    const status = make("p", { class: "lab-status", role: "status", "aria-live": "polite" });
    const charts = make("div", { class: "lab-charts" });
    const shownNow = make("p", { class: "lab-shown" });
    let waiting = 0;
    let last;

    function state() {
      const found = Object.fromEntries(sliders.map((slider, i) => [slider.name, Number(fields[i].input.value)]));
      choices.forEach((choice, i) => { found[choice.name] = sets[i].querySelector("input:checked").value; });
      return found;
    }
    const chosen = (now) => Object.fromEntries(choices.map((c) => [c.name, c.options.find(([value]) => value === now[c.name])[1]]));

    function draw(width = Math.floor(charts.clientWidth)) {
      if (!width || !last) return;
      while (charts.childElementCount < 2 * last.charts.length) {
        const id = `${root.id}-chart-${charts.childElementCount / 2}`;
        charts.append(make("p", { class: "lab-title", "aria-hidden": "true" }), make("svg:svg", { id, role: "img", "aria-labelledby": `${id}-title`, "aria-describedby": `${id}-desc` }));
      }
      last.charts.forEach((chart, i) => {
        charts.children[2 * i].textContent = chart.title;
        drawChart(charts.children[2 * i + 1], chart, width);
      });
    }

    function refresh() {
      const now = state();
      sliders.forEach((slider, i) => {
        const unit = slider.by ? slider.units[now[slider.by]] : slider.unit;
        const text = lab.told[slider.name]?.(now) ?? sliderText(slider, now[slider.name], unit);
        fields[i].output.textContent = text;
        fields[i].input.setAttribute("aria-valuetext", text);
      });
      last = lab.view(now, chosen(now));
      fillTable(table, last);
      shownNow.textContent = `The charts show: ${last.setting}. The caption tells where the sliders begin.`;
      draw();
      clearTimeout(waiting); // said once a slider rests
      waiting = setTimeout(() => { status.textContent = last.sentence; }, 300);
    }

    reset.addEventListener("click", () => {
      sliders.forEach((slider, i) => { fields[i].input.value = slider.start; });
      choices.forEach((choice, i) => { sets[i].querySelector(`[value="${choice.start}"]`).checked = true; });
      refresh();
    });
    // all is computed and drawn once before the page is changed: if that fails, the picture is there
    refresh();
    draw(320);
    root.setAttribute("aria-label", title);
    root.append(
      make("div", { class: "lab-controls" }, ...sets, ...fields.map((f) => f.field), reset),
      table, status, charts, shownNow,
    );
    const holder = root.closest(".cell_output");
    figure.prepend(root);
    if (holder && !holder.contains(figure)) holder.hidden = true; // an empty box is left
    figure.classList.add("lab-started");
    root.hidden = false;
    new ResizeObserver(() => draw()).observe(charts); // which calls it at once
  }

  /** Start each lab of the page; one that fails leaves its picture, and the others alone. */
  function startAll() {
    for (const root of document.querySelectorAll("section.lab[data-lab]")) {
      try {
        start(root);
      } catch (error) {
        console.error(`The lab ${root.id} does not start.`, error);
      }
    }
  }

  window.inswsnLabs = {
    cholesky, solveFactored, kalmanGains, runFilter, radialKernel, fitLssvm, predictLssvm, forward, inverse2, meanAbsolute, median, shown, places, gainLab, kernelLab, start,
  };
  if (document.readyState === "loading") document.addEventListener("DOMContentLoaded", startAll);
  else startAll();
})();
