/* A reader's own recording, on the pages "Your own data" and "Which filter?": drop a CSV file, see what comes of it.

   The page has an empty <section id="own-data" hidden data-example="…">, with its heading, what it says, and the
   function of Python that looks at the file. Where Python runs in the page, by window.inswsnLive, this script fills
   and shows it. The file is read here and given to Python in this browser; it is sent nowhere. Python computes and
   words everything (inswsn_book.live.own_page, which_page), and its charts are drawn as all others that move (moving.js). What
   comes from a file is set as text alone. */
"use strict";

(() => {
  if (window.inswsnOwnData) return; // included twice

  const LARGEST = 50e6; // bytes: more lines than Python takes, and nothing to load into a page

  function make(name, attributes = {}, ...children) {
    const node = document.createElement(name);
    for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
    node.append(...children); // a string becomes text, never HTML
    return node;
  }

  // What was found -------------------------------------------------------------------------------

  function tableOf({ caption, header, rows }) {
    const cell = (text, i) => (i ? make("td", {}, text) : make("th", { scope: "row" }, text));
    return make("table", { class: "table own-data-table" },
      make("caption", {}, caption),
      make("thead", {}, make("tr", {}, ...header.map((text) => make("th", { scope: "col" }, text)))),
      make("tbody", {}, ...rows.map((row) => make("tr", {}, ...row.map(cell)))));
  }

  let address = ""; // of the file for download

  function downloadOf({ csv, name }) {
    URL.revokeObjectURL(address);
    address = URL.createObjectURL(new Blob([csv], { type: "text/csv" }));
    const file = `${name.replace(/\.[^.]*$/, "")}-corrected.csv`;
    return csv && make("p", {}, make("a", { class: "btn btn-sm own-data-button", href: address, download: file }, "Download the corrected track (CSV)"));
  }

  /** Put what was found into its place, with its charts. */
  function show(place, found) {
    const content = make("script", { type: "application/json" }, JSON.stringify(found.figure));
    const charts = make("section", { class: "moving", id: "own-data-moving", "data-figure": "own-data-figure" }, content);
    place.replaceChildren(
      make("h3", {}, found.figure.title),
      make("ul", {}, ...found.sentences.map((text) => make("li", {}, text))),
      downloadOf(found) ?? make("pre", { tabindex: "0", "aria-label": "Code with your numbers" }, found.code), make("div", { id: "own-data-figure" }), charts, ...found.tables.map(tableOf),
    );
    place.hidden = false;
    window.inswsnMoving.start(charts);
  }

  // What a reader does ---------------------------------------------------------------------------

  function noiseField({ name, label, unit, usual }) {
    const input = make("input", { type: "number", id: `own-data-${name}`, min: 0, step: "any", value: usual, autocomplete: "off" });
    return { name, input, field: make("div", {}, make("label", { for: input.id }, `${label} (${unit})`), input) };
  }

  function start(root) {
    if (root.childElementCount) return; // started before
    const button = (text) => make("button", { type: "button", class: "btn btn-sm own-data-button" }, text);
    const file = make("input", { type: "file", id: "own-data-file", accept: ".csv,.txt,.tsv,text/csv" });
    const example = button("Show an example");
    const again = button("Compute again");
    const fields = window.inswsnLive.noise.map(noiseField);
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
      return window.inswsnLive.call(root.dataset.look, [recording.text, { name: recording.name, ...Object.fromEntries(figures) }]);
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
      make("label", { for: file.id }, "Choose a CSV file with an INS and a network, or drop one here"), file, example);
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
      make("h2", { id: "own-data-heading" }, root.dataset.heading),
      make("p", {}, root.dataset.said),
      drop,
      ...(fields.length ? [make("details", {}, make("summary", {}, "Noise figures of the filter (standard deviations)"),
        make("div", { class: "own-data-figures" }, ...fields.map(({ field }) => field), again))] : []),
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
