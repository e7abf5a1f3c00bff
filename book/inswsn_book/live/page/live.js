/* Code cells that run where they are read.

   `make live` puts this script into the lessons, with what it knows of their cells: <script id="live">. It loads
   nothing more before a reader presses Run. Then Python runs in a worker of the page (live-worker.js). */
"use strict";

(() => {
  const SERVE = "python -m http.server --bind 127.0.0.1";
  const HINT = "Code runs where you read it: change a cell and press Run, or Ctrl and Enter. Cells that need it follow, with their figures. "
    + "Text and tables stay the book's; a sentence that your numbers make untrue is named.";
  // what is coloured in code that was edited, by the first of these that begins at a place
  const TOKENS = new RegExp([
    "(?<comment>#.*)",
    `(?<string>[rbfu]{0,2}(?:"""[^]*?(?:"""|$)|'''[^]*?(?:'''|$)|"(?:\\\\.|[^"\\\\\\n])*"?|'(?:\\\\.|[^'\\\\\\n])*'?))`,
    "(?<number>\\b(?:0x[\\da-f]+|\\d[\\d_]*(?:\\.\\d*)?(?:e[-+]?\\d+)?j?))",
    "(?<keyword>\\b(?:False|None|True|and|as|assert|async|await|break|class|continue|def|del|elif|else|except|finally|for|from|global|if|import"
      + "|in|is|lambda|nonlocal|not|or|pass|raise|return|try|while|with|yield)\\b)",
    "\\w+",
  ].join("|"), "g");
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

  /** The colours of edited code: painted over it, so that the caret and what can be undone stay. */
  const colours = Object.fromEntries((window.Highlight ? ["comment", "string", "number", "keyword"] : []).map((kind) => {
    CSS.highlights.set(`live-${kind}`, new Highlight());
    return [kind, CSS.highlights.get(`live-${kind}`)];
  }));

  /** Return the ranges of the words of some code that are coloured, [kind, range] each. */
  function coloured(code) {
    const [pieces, walk] = [[], document.createTreeWalker(code)];
    let text = "";
    while (walk.nextNode()) {
      const node = walk.currentNode;
      if (node.data) pieces.push([text.length, node]);
      text += node.data ?? (node.localName === "br" ? "\n" : "");
    }
    return [...text.matchAll(TOKENS)].flatMap(({ 0: word, index, groups }) => {
      const [kind, range] = [Object.keys(groups).find((each) => groups[each]), new Range()];
      if (!colours[kind]) return [];
      const place = (at) => pieces.findLast(([begins]) => begins <= at);
      const [[from, first], [to, last]] = [place(index), place(index + word.length - 1)];
      range.setStart(first, index - from);
      range.setEnd(last, index + word.length - to);
      return [[kind, range]];
    });
  }

  function button(text, what, act) {
    const made = make("button", { type: "button", class: "live-button", "aria-label": `${text} ${what}`.trim() }, text);
    made.addEventListener("click", act);
    return made;
  }

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
      this.told = make("div", { class: "live-told" }); // errors of other cells, by what was edited here
      this.because = make("span"); // of an error, or of not being run: a link to where it comes from
      this.error = "";
      this.colours = [];
      this.bar = make("div", { class: "live-bar" });
      this.code.id ||= `live-cell-${number + 1}`;
    }

    /** Buttons below the code, or what it would need. */
    build(cells) {
      if (this.runs) {
        // what needs a cell that has changed, or shows what another source has made, follows it
        const name = `cell ${this.number + 1}`;
        this.run = button("Run", name, () => request(cells, this, [this.number], this.source !== this.last || this.isOld(cells)));
        this.halt = button("Stop", name, stop);
        this.reset = button("Reset", name, () => this.putBack(cells));
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
        this.bar.append(this.run, this.halt, this.reset, this.status, this.because);
      } else {
        this.bar.append(`Not in the page: it needs ${this.about.needs}.`, this.status);
        const next = cells.slice(this.number + 1).find((cell) => cell.runs);
        if (next) this.bar.append(make("a", { href: `#${next.code.id}` }, "To the next that runs."));
        if (cells.find((cell) => !cell.runs) === this) {
          this.bar.append(make("a", { href: new URL("../reproduce.html#in-jupyterlab", here) }, "On your own machine all cells run."));
        }
      }
      this.input.after(this.bar, this.out, this.told);
    }

    get edited() { return this.source !== this.first.source; }

    get link() { return make("a", { href: `#${this.code.id}` }, `cell ${this.number + 1}`); }

    /** Show whether a reader has changed it, or what it shows; what was coloured as code may be another word now. */
    showEdited() {
      this.code.classList.toggle("live-edited", this.edited);
      this.reset.hidden = !this.edited && !Object.keys(this.shown).length;
      for (const [kind, range] of this.colours) colours[kind].delete(range);
      this.colours = this.edited ? coloured(this.code) : [];
      for (const [kind, range] of this.colours) colours[kind].add(range);
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
      this.error = said.error;
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
      blame(cells, this);
    }

    putBackResults() {
      this.printed.forEach((node) => { node.hidden = false; });
      for (const [name, text] of this.first.figures) redraw(name, text);
      this.first.figures.clear();
      this.shown = {};
      this.out.hidden = true;
      this.error = "";
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

  /** Show an error beside the cell that was edited and makes another fail, and links from that one, and from those that wait for it. */
  function blame(cells, first) {
    for (const cell of cells) for (const node of [cell.told, cell.because]) node.replaceChildren();
    for (const cell of cells.filter(({ error }) => error)) {
      const edited = cell.needed(cells).filter((each) => each.edited);
      const by = [cell, first, ...edited].find((each) => edited.includes(each));
      if (by && by !== cell) {
        by.told.append(make("p", {}, "By this, ", cell.link, " fails:"), make("pre", { class: "live-out live-error", tabindex: "0", "aria-label": "Its error" }, cell.error));
        cell.out.textContent = cell.error.trim().split("\n").at(-1);
        cell.because.append("by what was edited in ", by.link);
      }
      for (const other of cells) {
        if (!other.runs || other.error || !other.isOld(cells) || !other.about.before.includes(cell.number)) continue;
        other.status.textContent = "not run: it needs";
        other.because.replaceChildren(cell.link);
      }
    }
  }

  /** Run cells with those that they need above, for one or for the page; `below` with those that need it or are out of date. */
  async function request(cells, first, asked, below) {
    if (busy) return;
    busy = true;
    const live = cells.filter((cell) => cell.runs);
    const untrue = [];
    let stopped = "";
    const wanted = [...asked, ...(below ? live.filter((cell) => cell !== first && cell.isOld(cells)).map((cell) => cell.number) : [])];
    live.forEach((cell) => { cell.run.disabled = true; });
    first.halt.hidden = false;
    first.status.textContent = worker ? "waits" : `Python starts: ${known.megabytes} MB, once`;
    try {
      await send({ run: { sources: cells.map((cell) => cell.source), runs: cells.map((cell) => cell.runs), wanted, below } },
        (said) => {
          const cell = cells[said.cell];
          if (said.text && cell !== first) untrue.push(...(said.text.match(UNTRUE) ?? []));
          cell.take(said, cells);
        });
    } catch (error) {
      stopped = error.message;
      for (const cell of cells) {
        if (!/^(runs,|runs$|waits|Python starts)/.test(cell.status.textContent)) continue;
        cell.status.textContent = "";
        cell.out.hidden = true; // it is of a run before
      }
    }
    cells.forEach((cell) => cell.mark(cells));
    if (!cells.includes(first)) first.status.textContent = "All have run.";
    const failed = cells.filter((cell) => cell.error && cell !== first).length;
    first.status.textContent = stopped || toldOf(cells, first, failed, untrue);
    blame(cells, first);
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
        request(cells, cell, [cell.number], true);
      });
      cell.reset.addEventListener("click", () => { field.value = value; });
      return make("div", { class: "live-field" }, make("label", { for: field.id, title: meaning }, name), field);
    });
    cell.bar.prepend(...fields);
  }

  /** Buttons for all cells of the page. */
  function barOfAll(cells) {
    const live = cells.filter((cell) => cell.runs);
    const page = { status: make("span", { class: "live-status", role: "status" }), halt: button("Stop", "", stop) };
    page.halt.hidden = true;
    return make("div", { class: "live-bar" },
      button("Run all", "", () => request(cells, page, live.map((cell) => cell.number), false)), page.halt,
      button("Reset all", "", () => live.forEach((cell) => cell.reset.hidden || cell.reset.click())), page.status);
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
    cells[0]?.box.before(make("p", { class: "live-bar" }, HINT), barOfAll(cells));
  }

  if (document.readyState === "loading") document.addEventListener("DOMContentLoaded", start);
  else start();
})();
