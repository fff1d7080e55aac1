// Everything shown, in the address after #, so that a link restores it.

const WHOLE = { seed: [0, 2 ** 53 - 1], chosen: [0, 2], step: [0, 400], grid: [0, 90], dial: [0, 1], fleet: [0, 90], trained: [0, 2], chapter: [0, 5], latency: [0, 2], unseen: [0, 50], noise: [0, 5], front: [0, 1] };
const WORDS = { view: ["side", "ghosts"], tab: ["story", "drive", "sold", "turn", "grid", "fleet", "people", "late", "about"], speed: ["0.25", "0.5", "1", "2", "4"] };

export const FIRST = { seed: 1, angles: [0, 45, 85], chosen: 1, step: 0, view: "side", tab: "story", speed: "1", grid: 45, dial: 0, fleet: 45, trained: 2, chapter: 0, latency: 0, unseen: 0, noise: 0, front: 0 };

/** Return the text after # for a state. */
export function writeAddress(state) {
  const parts = Object.keys(FIRST).map((name) => `${name}=${state[name]}`);
  return `#${parts.join("&")}`;
}

let keeping;

/** Write a state into the address, once it has not changed for a moment. */
export function keepAddress(state) {
  window.clearTimeout(keeping);
  keeping = window.setTimeout(() => window.history.replaceState(null, "", writeAddress(state)), 150);
}

/**
 * Return the state of a text after #; what is missing or wrong is as at first.
 *
 * @param {string} text The text.
 * @param {number[][]} ranges Smallest and largest angle of each dial.
 */
export function readAddress(text, ranges = [[0, 90]]) {
  const given = new URLSearchParams(text.replace(/^#/, ""));
  const state = { ...FIRST, angles: [...FIRST.angles] };
  if (given.has("seed") || given.has("angles")) state.tab = "turn"; // a link that names no tab shows its twins
  for (const [name, [least, most]] of Object.entries(WHOLE)) {
    const value = Number(given.get(name) ?? NaN);
    if (Number.isInteger(value) && value >= least && value <= most) state[name] = value;
  }
  for (const [name, known] of Object.entries(WORDS)) if (known.includes(given.get(name))) state[name] = given.get(name);
  const angles = (given.get("angles") ?? "").split(",").filter((one) => one.trim() !== "").map(Number);
  const right = angles.every((angle) => Number.isInteger(angle) && angle >= 0 && angle <= 90);
  if (right && angles.length >= 1 && angles.length <= 3) state.angles = angles;
  if (state.dial >= ranges.length) state.dial = FIRST.dial;
  state.trained = Math.min(state.trained, ranges.length - 1);
  const [low, high] = ranges[state.dial];
  const within = (angle) => Math.min(Math.max(angle, low), high);
  [state.angles, state.fleet] = [state.angles.map(within), within(state.fleet)];
  state.chosen = Math.min(state.chosen, state.angles.length - 1);
  return state;
}
