// Order of the site's search: pages before names of the code, first those whose title has the query.
var Scorer = {
  objNameMatch: 3, objPartialMatch: 1, objPrio: { 0: 2, 1: 0, 2: -5 }, objPrioDefault: 0,
  title: 15, partialTitle: 7, term: 5, partialTerm: 2,
  score: ([page, title, , , score]) => {
    const query = new URLSearchParams(window.location.search).get("q") ?? "";
    const titled = title.toLowerCase().includes(query.trim().toLowerCase());
    return score + (page.startsWith("reference/") ? -10 : titled ? 5 : 0);
  },
};
