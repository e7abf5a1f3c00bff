// Sphinx's search, by what a page is for. What the index has exactly is first, then lessons and what
// to use, then evidence, then the rest; among pages of a kind the order is Sphinx's.
var Scorer = {
  score: ([page, , , , score]) =>
    (score >= 100 ? 10000 : 0) + (/^chapters\/[^/]+$/.test(page) ? 2000 : page.startsWith("chapters/") ? 1000 : 0) + score,
  // and as Sphinx has them
  objNameMatch: 11,
  objPartialMatch: 6,
  objPrio: { 0: 15, 1: 5, 2: -5 },
  objPrioDefault: 0,
  title: 15,
  partialTitle: 7,
  term: 5,
  partialTerm: 2,
};
