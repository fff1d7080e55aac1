// Order of the site's search: pages before names of the code.
var Scorer = {
  objNameMatch: 3, objPartialMatch: 1, objPrio: { 0: 2, 1: 0, 2: -5 }, objPrioDefault: 0,
  title: 15, partialTitle: 7, term: 5, partialTerm: 2,
};
