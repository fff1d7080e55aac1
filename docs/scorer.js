// Order of the site's search: pages before names of the code, first those whose title has the query.
const PAGES = { latency: "shifts", ind: "recordings" }; // of words that no title has
var Scorer = {
  objNameMatch: 3, objPartialMatch: 1, objPrio: { 0: 2, 1: 0, 2: -5 }, objPrioDefault: 0,
  title: 15, partialTitle: 7, term: 5, partialTerm: 2,
  score: ([page, title, , , score]) => {
    if (page.startsWith("reference/")) return score - 10;
    const query = (new URLSearchParams(window.location.search).get("q") ?? "").trim().toLowerCase();
    return score + (title.toLowerCase().includes(query) ? 5 : 0) + (PAGES[query] === page ? 10 : 0);
  },
};
