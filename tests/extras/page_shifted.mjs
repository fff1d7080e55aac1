// Episodes with faults: `node page_shifted.mjs CORE LAYOUT DIAL ANGLE JOB OUT`. JOB holds a `shift`, `seeds`, and maybe `recorded`:
// for each seed the observations of an episode and what was decided on them. OUT gets for each seed what the driver was shown, what was
// carried out and how it ended; of recorded episodes what it was shown.

import { readFileSync, writeFileSync } from "node:fs";
import { Core } from "../../packages/socialiq/src/socialiq/page/assets/core.js";
import { Recorder, filmOf } from "../../packages/socialiq/src/socialiq/page/assets/film.js";
import { dialOf } from "../../packages/socialiq/src/socialiq/page/assets/network.js";
import { shifted } from "../../packages/socialiq/src/socialiq/page/assets/shifts.js";

const [core, layout, file, angle, job, out] = process.argv.slice(2);
const { shift, seeds, recorded } = JSON.parse(readFileSync(job));
const recorder = new Recorder(new Core(new WebAssembly.Module(readFileSync(core)), JSON.parse(readFileSync(layout)), 1, true));
const dial = dialOf(new Uint8Array(readFileSync(file))).at(Number(angle));

/** Return a network that keeps what it is shown. */
function watched(decide, shown) {
  const network = { of: () => network, decide: (seen, time) => { shown.push([...seen, time]); return decide(seen, time); } };
  return shifted(network, shift);
}

const episodes = seeds.map((seed, number) => {
  const shown = [];
  if (recorded) {
    const { observations, decided } = recorded[number];
    const driver = watched((_, time) => decided[time - (shift.front ? shift.latency : 0)], shown).of(seed);
    observations.forEach((row, time) => driver.decide(Float32Array.from(row), time));
    return { shown };
  }
  const film = filmOf(recorder, watched((seen, time) => dial.decide(seen, time), shown), seed);
  return { shown, actions: film.decisions.map(({ action }) => action), ending: film.ending };
});
writeFileSync(out, JSON.stringify(episodes));
