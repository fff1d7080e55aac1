// Which angles of a dial decide as a user did: the largest number of equal decisions.

const RESAMPLES = 1000;

/** Return for each film how many of its decisions each network takes, too: one row a film. */
export function agreements(films, networks) {
  return films.map((film) => networks.map((network) =>
    film.decisions.reduce((count, { action, before }, number) => count + (network.decide(before, number) === action ? 1 : 0), 0)));
}

/** Return the first and the last of the places with the largest sum over rows. */
function best(rows) {
  const sums = rows[0].map((_, place) => rows.reduce((sum, row) => sum + row[place], 0));
  const most = Math.max(...sums);
  return [sums.indexOf(most), sums.lastIndexOf(most), most];
}

/**
 * Return which place of the rows agrees most, the middle of equals, with a 95 % percentile bootstrap over the rows.
 *
 * @returns {{place: number, low: number, high: number, share: number}} Places; `share` of `decisions` that agree.
 */
export function likeliest(rows, decisions) {
  let word = 1; // a fixed stream (Lehmer 1951, by Park and Miller): the same episodes, the same interval
  const draw = (below) => ((word = (word * 48271) % 2147483647) % below);
  const [first, last, most] = best(rows);
  const drawn = Array.from({ length: RESAMPLES }, () => best(rows.map(() => rows[draw(rows.length)])));
  const sorted = (end) => drawn.map((ends) => ends[end]).sort((first, second) => first - second);
  const low = sorted(0)[Math.floor(0.025 * RESAMPLES)];
  const high = sorted(1)[Math.ceil(0.975 * RESAMPLES) - 1];
  return { place: Math.round((first + last) / 2), low: Math.min(low, first), high: Math.max(high, last), share: most / decisions };
}
