/* Code cells that run where they are read.

   `make live` puts this script into the lessons, with what it knows of their cells: <script id="live">. It loads
   nothing more before a reader presses Run. Then Python runs in a worker of the page (live-worker.js). */
"use strict";

(() => {
  const SERVE = "python -m http.server --bind 127.0.0.1";
  const HINT = "Code runs where you read it: change a cell and press Run, or Ctrl and Enter. Cells that need it follow, with their figures. "
    + "Text and tables stay the book's; a sentence that your numbers make untrue is named.";
  const here = new URL(".", document.currentScript.src);
  const known = JSON.parse(document.getElementById("live").textContent);

  function make(name, attributes = {}, ...children) {
    const node = document.createElement(name);
    for (const [key, value] of Object.entries(attributes)) if (value !== null) node.setAttribute(key, value);
    node.append(...children);
    return node;
  }

  // ---- what runs Python: it takes a request and tells what comes back to a function

  let worker;
  const waiting = new Map();
  let serial = 0;

  function send(request, tell) {
    worker ??= Object.assign(new Worker(new URL("live-worker.js", here)), {
      onmessage: ({ data }) => waiting.get(data.id)(data),
      onerror: (event) => { for (const each of [...waiting.values()]) each({ ended: true, failed: event.message || "Python did not start." }); },
    });
    const id = ++serial;
    return new Promise((resolve, reject) => {
      waiting.set(id, (said) => {
        if (!said.ended) return tell(said);
        waiting.delete(id);
        return said.failed ? reject(new Error(said.failed)) : resolve(said);
      });
      worker.postMessage({ id, ...request });
    });
  }

  function stop() {
    worker?.terminate();
    worker = undefined;
    for (const each of [...waiting.values()]) each({ ended: true, failed: "Stopped. The next run starts Python anew." });
  }

  /** A function of the library, for other scripts of the page. */
  async function call(place, values) {
    const said = await send({ place, values }, () => {});
    if (said.error) throw new Error(said.error);
    return said.value;
  }

  if (location.protocol !== "file:") window.inswsnLive = { call, noise: known.noise };

  // ---- the cells of the page

  let busy = false;

  /** Give a figure that moves another content, where its sliders stand. */
  function redraw(name, text) {
    const root = document.getElementById(`${name}-moving`);
    if (!root?.moving) return;
    const { places } = root.moving;
    const content = JSON.parse(text);
    for (const slider of content.sliders) {
      if (places[slider.name] < slider.texts.length) slider.start = places[slider.name];
    }
    root.replaceChildren(make("script", { type: "application/json" }, JSON.stringify(content)));
    window.inswsnMoving.start(root);
  }

  const contentOf = (name) => document.getElementById(`${name}-moving`)?.querySelector("script").textContent;

  class Cell {
    constructor(input, number, about) {
      Object.assign(this, { input, number, about, runs: !about.needs });
      this.box = input.closest(".cell");
      this.code = input.querySelector("pre");
      this.printed = [...this.box.querySelectorAll(".cell_output > .output.stream, .cell_output > .output.text_plain")];
      this.source = this.code.textContent;
      this.first = { html: this.code.innerHTML, source: this.source, figures: new Map() };
      this.last = this.source; // that was run
      this.shown = {}; // the sources by which it shows what it shows, of this cell and those it needs, if not the book's
      this.status = make("span", { class: "live-status", role: "status" });
      this.out = make("pre", { class: "live-out", tabindex: "0", "aria-label": `What cell ${number + 1} says` });
      this.out.hidden = true;
      this.bar = make("div", { class: "live-bar" });
      this.code.id ||= `live-cell-${number + 1}`;
    }

    /** Buttons below the code, or what it would need. */
    build(cells) {
      if (this.runs) {
        // what needs a cell that has changed, or shows what another source has made, follows it
        this.run = this.button("Run", () => request(cells, this.number, this.source !== this.last || this.isOld(cells)));
        this.halt = this.button("Stop", stop);
        this.reset = this.button("Reset", () => this.putBack(cells));
        this.halt.hidden = this.reset.hidden = true;
        for (const [key, value] of Object.entries({ contenteditable: "plaintext-only", spellcheck: "false", role: "textbox",
          "aria-multiline": "true", "aria-label": `Code of cell ${this.number + 1}`, tabindex: "0" })) this.code.setAttribute(key, value);
        this.code.addEventListener("input", () => {
          this.source = this.code.innerText; // an Enter makes a <br>, which is no text content
          this.showEdited();
        });
        this.code.addEventListener("keydown", (event) => {
          if (event.key !== "Enter" || !(event.ctrlKey || event.metaKey || event.shiftKey)) return;
          event.preventDefault();
          this.run.click();
        });
        this.bar.append(this.run, this.halt, this.reset, this.status);
      } else {
        this.bar.append(`Not in the page: it needs ${this.about.needs}.`, this.status);
        const next = cells.slice(this.number + 1).find((cell) => cell.runs);
        if (next) this.bar.append(make("a", { href: `#${next.code.id}` }, "To the next that runs."));
        if (cells.find((cell) => !cell.runs) === this) {
          this.bar.append(make("a", { href: new URL("../reproduce.html#in-jupyterlab", here) }, "On your own machine all cells run."));
        }
      }
      this.input.after(this.bar, this.out);
    }

    button(text, act) {
      const button = make("button", { type: "button", class: "live-button", "aria-label": `${text} cell ${this.number + 1}` }, text);
      button.addEventListener("click", act);
      return button;
    }

    /** Show whether a reader has changed it, or what it shows; what was coloured as code may be another word now. */
    showEdited() {
      const edited = this.source !== this.first.source;
      this.code.classList.toggle("live-edited", edited);
      this.reset.hidden = !edited && !Object.keys(this.shown).length;
    }

    /** This cell and those that it needs. */
    needed(cells) { return [...this.about.before, this.number].map((i) => cells[i]); }

    /** Whether it shows what another source has made, of itself or of a cell that it needs. */
    isOld(cells) { return this.needed(cells).some((cell) => cell.last !== (this.shown[cell.number] ?? cell.first.source)); }

    /** Say so if it is. */
    mark(cells) {
      const [old, said] = [this.isOld(cells), this.runs ? OLD : OF_THE_BOOK];
      if (old) this.status.textContent = said;
      else if (this.status.textContent === said) this.status.textContent = "";
    }

    /** Take what Python says of this cell. */
    take(said, cells) {
      if (said.starts) {
        this.last = this.source;
        this.status.textContent = said.of > 1 ? `runs, ${said.starts} of ${said.of}` : "runs";
        return;
      }
      for (const [name, text] of said.figures) {
        if (!this.first.figures.has(name)) this.first.figures.set(name, contentOf(name));
        redraw(name, text);
      }
      this.printed.forEach((node) => { node.hidden = true; });
      const text = said.text + (said.error || "");
      this.out.textContent = text;
      this.out.hidden = !text;
      this.out.classList.toggle("live-error", Boolean(said.error || said.needs));
      this.shown = Object.fromEntries(this.needed(cells).map((cell) => [cell.number, cell.last]));
      this.status.textContent = said.needs ? `This needs ${said.needs}, which is not in the page.` : this.tellTime(said);
      this.showEdited();
    }

    /** How long it took, and what it is to be held against if that was long. */
    tellTime({ seconds, error }) {
      const took = `${error ? "failed after" : "took"} ${seconds.toFixed(seconds < 1 ? 2 : 1)} s`;
      if (seconds < 1 || error) return took;
      return `${took}: Python in this page computed all its numbers again. Building the book, this cell took ${this.about.seconds} s.`;
    }

    /** Put back the code, and what it and the cells that need it show, where nothing else was changed. */
    putBack(cells) {
      this.code.innerHTML = this.first.html; // as the book has it
      this.source = this.last = this.first.source;
      this.showEdited();
      const asInBook = (cell) => cell.needed(cells).every(({ last, first }) => last === first.source);
      const others = cells.filter((cell) => cell === this || Object.keys(cell.shown).length);
      others.filter(asInBook).forEach((cell) => cell.putBackResults());
      cells.forEach((cell) => cell.mark(cells));
    }

    putBackResults() {
      this.printed.forEach((node) => { node.hidden = false; });
      for (const [name, text] of this.first.figures) redraw(name, text);
      this.first.figures.clear();
      this.shown = {};
      this.out.hidden = true;
      this.status.textContent = "as in the book";
      this.showEdited();
    }
  }

  const OLD = "out of date: run it";
  const OF_THE_BOOK = "It shows the book's numbers, not yours.";
  const UNTRUE = /^No longer true: .*$/gm; // as inswsn_book.live.unrecorded says it

  /** What a reader has to know of other cells, once one has run. */
  function toldOf(cells, first, failed, untrue) {
    const old = cells.filter((cell) => cell !== first && cell.isOld(cells));
    const count = (runs) => old.filter((cell) => cell.runs === runs).length;
    const some = (n) => (n === 1 ? "1 other cell" : `${n} other cells`);
    const told = [
      ...(failed ? [`Failed: ${some(failed)}.`] : []),
      ...untrue,
      ...(count(true) ? [`Out of date: ${some(count(true))}.`] : []),
      ...(count(false) ? [`By the book's numbers, since not in the page: ${some(count(false))}.`] : []),
    ];
    return told.length ? [first.status.textContent.replace(/\.?$/, "."), ...told].join(" ") : first.status.textContent;
  }

  /** Run a cell with those that it needs above; if it is another now, with those below that need it or are out of date. */
  async function request(cells, number, below) {
    if (busy) return;
    busy = true;
    const live = cells.filter((cell) => cell.runs);
    const [first, untrue] = [cells[number], []];
    let [failed, stopped] = [0, ""];
    const wanted = [number, ...(below ? live.filter((cell) => cell !== first && cell.isOld(cells)).map((cell) => cell.number) : [])];
    live.forEach((cell) => { cell.run.disabled = true; });
    first.halt.hidden = false;
    first.status.textContent = worker ? "waits" : `Python starts: ${known.megabytes} MB, once`;
    try {
      await send({ run: { sources: cells.map((cell) => cell.source), runs: cells.map((cell) => cell.runs), wanted, below } },
        (said) => {
          const cell = cells[said.cell];
          if (said.error && cell !== first) failed += 1;
          if (said.text && cell !== first) untrue.push(...(said.text.match(UNTRUE) ?? []));
          cell.take(said, cells);
        });
    } catch (error) {
      stopped = error.message;
      for (const cell of cells) {
        if (!/^(runs|waits|Python starts)/.test(cell.status.textContent)) continue;
        cell.status.textContent = "";
        cell.out.hidden = true; // it is of a run before
      }
    }
    cells.forEach((cell) => cell.mark(cells));
    first.status.textContent = stopped || toldOf(cells, first, failed, untrue);
    busy = false;
    live.forEach((cell) => { cell.run.disabled = false; });
    first.halt.hidden = true;
  }

  /** A field for each parameter: when it changes, so does the cell, and what needs it runs. */
  function addParameters(cells) {
    const cell = cells.find(({ box }) => box.classList.contains("tag_parameters"));
    if (!cell?.runs) return;
    const fields = known.parameters.map(({ name, value, low, high, above, below, whole, meaning }) => {
      const field = make("input", { type: "number", id: `live-${name}`, value, step: whole ? 1 : "any", min: low, max: high, autocomplete: "off" });
      field.addEventListener("change", () => {
        const open = [above && field.value <= low && `above ${low}`, below && field.value >= high && `below ${high}`].find(Boolean);
        field.setCustomValidity(open ? `Value must be ${open}.` : "");
        if (!field.reportValidity()) return;
        const line = new RegExp(`^(${name}\\s*:\\s*\\w+\\s*=\\s*)[^#\\n]*?(\\s*(?:#.*)?)$`, "m");
        cell.source = cell.source.replace(line, (_, start, end) => start + field.value + end);
        cell.code.textContent = cell.source;
        cell.showEdited();
        request(cells, cell.number, true);
      });
      cell.reset.addEventListener("click", () => { field.value = value; });
      return make("div", { class: "live-field" }, make("label", { for: field.id, title: meaning }, name), field);
    });
    cell.bar.prepend(...fields);
  }

  function start() {
    const inputs = [...document.querySelectorAll(".cell_input")];
    if (location.protocol === "file:") {
      const line = make("p", { class: "live-bar" }, "To run the code of this page, serve its folder and open it there: ", make("code", {}, SERVE));
      inputs[0]?.before(line);
      return;
    }
    const cells = known.cells.map((about, number) => new Cell(inputs[number], number, about));
    cells.forEach((cell) => cell.build(cells));
    addParameters(cells);
    cells[0]?.box.before(make("p", { class: "live-bar" }, HINT));
  }

  if (document.readyState === "loading") document.addEventListener("DOMContentLoaded", start);
  else start();
})();
