// A box that scrolls can be reached and scrolled by the keyboard, and says what it is. Whether it
// scrolls depends on the window, so it is measured. The theme makes tab stops of code and tables
// that scroll, without a name.
(() => {
  const NAMES = {
    ".bd-content figure": "Figure",
    ".bd-content pre": "Code",
    ".bd-content .pst-scrollable-table-container": "Table",
    ".bd-content div.cell_output": "Output",
    '.bd-content mjx-container[display="true"]': "Formula",
  };

  function measure() {
    // All that was set before is taken back, then all is read, then all is written: a change between
    // two readings would lay out the page anew.
    const boxes = Object.entries(NAMES).flatMap(([selector, name]) =>
      [...document.querySelectorAll(selector)].map((box) => ({ box, name })));
    const formulas = [...document.querySelectorAll("mjx-container:not([display])")];
    for (const formula of formulas) if ("scrolls" in formula.dataset) unmark(formula);
    const found = boxes.map(({ box, name }) => ({ box, name, scrolls: scrollsNow(box) }));
    const wide = formulas.filter(tooWide);
    for (const { box, name, scrolls } of found) {
      if (scrolls) mark(box, name);
      else if ("scrolls" in box.dataset) unmark(box);
    }
    for (const formula of wide) mark(formula, "Formula");
    document.documentElement.dataset.measured = window.innerWidth;  // for the tests
  }

  function scrollsNow(box) {
    return box.scrollWidth > box.clientWidth && getComputedStyle(box).overflowX !== "visible";
  }

  // A formula that is wider than its paragraph scrolls as one on a line of its own does.
  function tooWide(formula) {
    const line = formula.parentElement.closest("p, li, dd, dt, td, th, figcaption, caption, div");
    return line && line.clientWidth > 0 && formula.scrollWidth > line.clientWidth + 1;
  }

  // What was set here, so that nothing else is taken away.
  const given = new WeakMap();

  function mark(box, name) {
    box.dataset.scrolls = "";
    if (box.isContentEditable) return; // live.js has named it
    if (!given.has(box)) {
      const own = [];
      if (box.localName !== "figure") own.push("role");
      own.push("aria-label");
      given.set(box, own.filter((attribute) => !box.hasAttribute(attribute)));
    }
    const mine = given.get(box);
    box.tabIndex = 0;
    if (mine.includes("role")) box.setAttribute("role", "group");
    if (mine.includes("aria-label"))
      box.setAttribute("aria-label", `${numbered(box) || name}, scrolls sideways`);
  }

  function unmark(box) {
    delete box.dataset.scrolls;
    if (box.isContentEditable) return;
    for (const attribute of given.get(box) ?? []) box.removeAttribute(attribute);
    given.delete(box);
    box.removeAttribute("tabindex");
  }

  function numbered(box) {
    return box.querySelector(".caption-number")?.textContent.trim();
  }

  // To typeset the hundreds of formulas of the page of claims takes seconds: those of a claim are once
  // it comes near the window, and all before they are printed.
  function typeset() {
    const left = new Set(document.querySelectorAll(".claim"));
    if (!left.size) return MathJax.startup.defaultPageReady();
    const now = (claims) => {
      for (const claim of claims) left.delete(claim);
      MathJax.typeset(claims);
      later();
    };
    const watch = new IntersectionObserver((seen) => {
      now(seen.filter(({ target, isIntersecting }) => isIntersecting && left.has(target)).map(({ target }) => target));
    }, { rootMargin: "50%" });
    for (const claim of left) watch.observe(claim);
    window.addEventListener("beforeprint", () => now([...left]));
    return MathJax.typesetPromise([...document.querySelectorAll(".math")].filter((formula) => !formula.closest(".claim")));
  }
  if (window.MathJax) window.MathJax.startup = { pageReady: typeset };

  let due;
  function later() {
    clearTimeout(due);
    delete document.documentElement.dataset.measured;
    due = setTimeout(measure, 350); // after the theme's, which waits 300 ms
  }
  window.addEventListener("load", () => {
    measure();
    later();
    window.MathJax?.startup?.promise?.then(later);
  });
  window.addEventListener("resize", later);
  document.addEventListener("toggle", later, true); // what was folded had no width
})();

// A link to a place in a folded section opens it, where the browser does not do so by itself.
(() => {
  function reveal() {
    const place = document.getElementById(decodeURIComponent(location.hash.slice(1)));
    if (!place) return;
    const folded = [];
    // a heading and its labels stand outside of what is folded
    const own = place.closest("section")?.querySelector(":scope > details.fold");
    for (let box = own || place.closest("details"); box; box = box.parentElement.closest("details"))
      if (!box.open) folded.push(box);
    if (!folded.length) return;
    for (const box of folded) box.open = true;
    place.scrollIntoView();
  }
  window.addEventListener("hashchange", reveal);
  if (document.readyState === "loading") document.addEventListener("DOMContentLoaded", reveal);
  else reveal();
})();

// One button unfolds all sections of evidence, or folds them again.
(() => {
  function start() {
    const folds = [...document.querySelectorAll("details.fold")];
    if (folds.length < 3) return;
    const button = document.createElement("button");
    button.type = "button";
    button.className = "fold-all btn btn-sm";
    const name = () => { button.textContent = folds.every((fold) => fold.open) ? "Fold all" : "Unfold all"; };
    button.addEventListener("click", () => {
      const open = !folds.every((fold) => fold.open);
      for (const fold of folds) fold.open = open;
      name();
    });
    for (const fold of folds) fold.addEventListener("toggle", name);
    name();
    folds[0].closest("section").before(button);
  }
  if (document.readyState === "loading") document.addEventListener("DOMContentLoaded", start);
  else start();
})();

// No line begins with the point or the comma after a formula.
(() => {
  function join() {
    for (const formula of document.querySelectorAll(".bd-content span.math")) {
      const after = formula.nextSibling;
      const [signs] = (after?.nodeType === Node.TEXT_NODE && after.data.match(/^[.,;:?)’]+/)) || [];
      if (!signs) continue;
      const whole = Object.assign(document.createElement("span"), { className: "unbroken" });
      after.data = after.data.slice(signs.length);
      formula.replaceWith(whole);
      whole.append(formula, signs);
    }
  }
  if (document.readyState === "loading") document.addEventListener("DOMContentLoaded", join);
  else join();
})();
