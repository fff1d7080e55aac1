// Latency: the same car in the same traffic, on time and one second late, without and with a front end that knows it.

import { Beside } from "./beside.js";
import { writeAddress } from "./address.js";
import { filmOf } from "./film.js";
import { momentsOf } from "./moments.js";
import { NO_SHIFT, shifted } from "./shifts.js";

const ANGLE = 45; // degrees
const SEARCHED = 200; // seeds among which an episode is looked for that goes wrong by the latency alone
const SLOWER = 0;
const WORDS = [["brakes"], ["wants to brake: nothing happens yet", "brakes, one second too late"], ["looks ahead, and decides to brake", "brakes in time"]];
const TITLES = ["On time", "One second late", "Late, looking ahead"];
const SHIFTS = [NO_SHIFT, { ...NO_SHIFT, latency: 1 }, { ...NO_SHIFT, latency: 1, front: true }];

/** Return what to say when a car first decides to brake, and when it does: `[frame, words]` each. */
function braking({ decisions }, words, frames) {
  const from = decisions.findIndex(({ action }) => action === SLOWER);
  return from < 0 ? [] : words.map((text, number) => [(from - words.length + 1 + number) * frames, text]);
}

/** Return the films of the first seed at which only the late car collides, else of seed 1: on time, late, late with a front end. */
function filmsOf(recorder, networks, { arrival, collision }) {
  const drive = (seed) => networks.map((network) => filmOf(recorder, network, seed));
  for (let seed = 1; seed <= SEARCHED; seed += 1) {
    const films = drive(seed);
    if ([arrival, collision, arrival].every((ending, number) => films[number].ending === ending)) return films;
  }
  document.getElementById("late-chosen").hidden = true;
  return drive(1);
}

/**
 * Return the tab.
 *
 * @param {object} parts `{ layout, dial, shares, recorder, colours, state }`: shares of collisions on time, late, and late with
 *   a front end, if they were measured; `recorder` makes one.
 */
export function lateTab({ layout, dial, shares, recorder, colours, state }) {
  const find = (name) => document.getElementById(`late-${name}`);
  const angle = Math.min(Math.max(ANGLE, Math.ceil(dial.low)), Math.floor(dial.high));
  const percents = shares.map((share) => `${Math.round(100 * share)}\u00A0%`);
  find("angle").textContent = `${angle}°`;
  if (shares.length) find("shares").textContent = `Measured: on time ${percents[0]} of drives end in a collision, one second late ${percents[1]}, one second late but looking ahead ${percents[2]}.`;
  let films;
  const scenes = () => {
    films ??= filmsOf(recorder(), SHIFTS.map((shift) => shifted(dial.at(angle), shift)), layout.endings);
    find("seed").textContent = `seed ${films[0].seed}`;
    const right = find("front").checked ? 2 : 1;
    return [[0, right], [right, 0]].map(([number, other], place) => {
      const film = films[number];
      const moments = momentsOf(film, films[other], layout, braking(film, WORDS[number], layout.frames));
      return { title: TITLES[number], place, film, said: moments.at, label: moments.summary, live: true };
    });
  };
  const beside = new Beside("late", { layout, colours, scenes });
  find("front").addEventListener("change", () => beside.open());
  find("try").addEventListener("click", () => {
    window.location.hash = writeAddress({ ...state, tab: "turn", seed: films[0].seed, angles: [angle], chosen: 0, step: 0, dial: 0, latency: 1, front: Number(find("front").checked) });
  });
  return beside;
}
