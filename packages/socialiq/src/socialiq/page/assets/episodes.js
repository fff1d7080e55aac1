// Many episodes without pictures: rates and means of an angle, and seeds where angles differ.

import { shifted } from "./shifts.js";

const ROWS = 50; // episodes side by side

/** Return what the episodes of some seeds were worth: `{ seed, env, social, ending, decisions }`. */
export function episodesOf(core, network, seeds) {
  const found = [];
  for (let first = 0; first < seeds.length; first += core.rows) {
    found.push(...together(core, network, seeds.slice(first, first + core.rows)));
  }
  return found;
}

function together(core, network, seeds) {
  const { none } = core.layout.endings;
  const rows = seeds.map((seed) => ({ seed, env: 0, social: 0, ending: none, decisions: 0 }));
  const drivers = seeds.map((seed) => network.of(seed));
  for (let row = 0; row < core.rows; row += 1) {
    if (row < rows.length) core.begin(row, seeds[row]);
    else core.skip(row);
  }
  core.run();
  while (rows.some((one) => one.ending === none)) {
    const deciding = rows.map((one) => one.ending === none);
    rows.forEach((one, row) => {
      if (deciding[row]) core.decide(row, drivers[row].decide(core.observation(row), one.decisions));
      else core.skip(row);
    });
    core.run();
    rows.forEach((one, row) => {
      if (!deciding[row]) return;
      one.env += core.arrays.rewards[2 * row];
      one.social += core.arrays.rewards[2 * row + 1];
      one.ending = core.arrays.ending[row];
      one.decisions += 1;
    });
  }
  return rows;
}

/** Return rates and means with 95 % intervals: Wilson's for rates, normal for means. */
export function summaryOf(episodes, endings) {
  const rate = (ending) => wilson(episodes.filter((one) => one.ending === endings[ending]).length, episodes.length);
  return {
    episodes: episodes.length,
    arrival: rate("arrival"), collision: rate("collision"), timeout: rate("timeout"),
    env: meanOf(episodes.map((one) => one.env)), social: meanOf(episodes.map((one) => one.social)),
  };
}

const Z = 1.959964;

/** Return a share with Wilson's interval: `[share, low, high]`. */
export function wilson(count, of) {
  const share = count / of;
  const centre = (share + Z ** 2 / (2 * of)) / (1 + Z ** 2 / of);
  const half = (Z / (1 + Z ** 2 / of)) * Math.sqrt((share * (1 - share)) / of + Z ** 2 / (4 * of ** 2));
  return [share, centre - half, centre + half];
}

/** Return a mean with its interval: `[mean, low, high]`. */
export function meanOf(values) {
  const mean = values.reduce((sum, value) => sum + value, 0) / values.length;
  const squares = values.reduce((sum, value) => sum + (value - mean) ** 2, 0);
  const half = values.length > 1 ? Z * Math.sqrt(squares / (values.length - 1) / values.length) : Infinity;
  return [mean, mean - half, mean + half];
}

/** Return the seeds by how far the episodes of several angles lie apart, the furthest first. */
export function differing(byAngle, most) {
  const apart = byAngle[0].map(({ seed }, number) => {
    const ones = byAngle.map((episodes) => episodes[number]);
    const spread = (name) => Math.max(...ones.map((one) => one[name])) - Math.min(...ones.map((one) => one[name]));
    return { seed, apart: Math.hypot(spread("env"), spread("social")), endings: ones.map((one) => one.ending) };
  });
  return apart.sort((one, other) => other.apart - one.apart || one.seed - other.seed).slice(0, most);
}

/** Answer the page's messages in a worker: `{ angles, first, count, shift }` to episodes of each angle. */
export function answer(open) {
  let opened;
  self.onmessage = ({ data }) => {
    try {
      if (data.open) opened = open(data.open, ROWS);
      else {
        const { core, dial } = opened;
        const seeds = Array.from({ length: data.count }, (_, number) => data.first + number);
        const found = data.angles.map((angle) => episodesOf(core, shifted(dial.at(angle), data.shift), seeds));
        self.postMessage({ number: data.number, found });
      }
    } catch (error) {
      self.postMessage({ number: data.number, fault: error.message });
    }
  };
}
