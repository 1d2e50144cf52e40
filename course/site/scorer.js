// How Sphinx's search orders what it finds: what is taught first. A result is [page, title, anchor,
// description, score, file, kind]; a word in a section's title scores 15, in its text 5.

"use strict"; // `var`, as Sphinx declares the name once more
var Scorer = {
  objNameMatch: 11,
  objPartialMatch: 6,
  objPrio: { 0: 15, 1: 5, 2: -5 },
  objPrioDefault: 0,
  title: 15,
  partialTitle: 7,
  term: 5,
  partialTerm: 2,
  score: ([page, , , , score]) => {
    if (page === "glossary") return score + 60; // it says where the word is defined
    if (/^\d\d_/.test(page)) return score + 40; // a chapter
    if (page === "charts") return score - 10;
    return score;
  },
};
