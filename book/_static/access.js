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
    for (const [selector, name] of Object.entries(NAMES))
      document.querySelectorAll(selector).forEach((box) => mark(box, name));
    // Each formula has a menu. The hundreds within the text are no tab stops; those on lines of
    // their own are.
    // all is written before anything is read: each change between would lay out the page anew
    const formulas = [...document.querySelectorAll("mjx-container:not([display])")];
    for (const formula of formulas) {
      if (formula.tabIndex !== -1) formula.tabIndex = -1;
      if ("scrolls" in formula.dataset) delete formula.dataset.scrolls;
    }
    for (const formula of formulas.filter(tooWide)) mark(formula, "Formula", true);
    document.documentElement.dataset.measured = window.innerWidth;  // for the tests
  }

  // A formula that is wider than its paragraph scrolls as one on a line of its own does.
  function tooWide(formula) {
    const line = formula.parentElement.closest("p, li, dd, dt, td, th, figcaption, caption, div");
    return line && line.clientWidth > 0 && formula.scrollWidth > line.clientWidth + 1;
  }

  function mark(box, name, always = false) {
    const scrolls =
      always || (box.scrollWidth > box.clientWidth && getComputedStyle(box).overflowX !== "visible");
    if (scrolls) {
      box.tabIndex = 0;
      box.dataset.scrolls = "";
      if (!box.hasAttribute("role") && box.localName !== "figure") box.setAttribute("role", "group");
      box.setAttribute("aria-label", `${numbered(box) || name}, scrolls sideways`);
    } else if ("scrolls" in box.dataset) {
      for (const attribute of ["role", "aria-label", "data-scrolls"]) box.removeAttribute(attribute);
      if (box.localName !== "mjx-container") box.removeAttribute("tabindex");
    }
  }

  function numbered(box) {
    return box.querySelector(".caption-number")?.textContent.trim();
  }

  let due;
  function later() {
    clearTimeout(due);
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
