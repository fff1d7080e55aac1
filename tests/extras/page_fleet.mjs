// Fleets that the page drives: `node page_fleet.mjs CORE LAYOUT DIAL ANGLE COUNT FIRST LAST OUT`. OUT gets the endings and
// the number of decisions of each seed, and what was counted at the end.

import { readFileSync, writeFileSync } from "node:fs";
import { Core } from "../../packages/socialiq/src/socialiq/page/assets/core.js";
import { Recorder } from "../../packages/socialiq/src/socialiq/page/assets/film.js";
import { Fleet } from "../../packages/socialiq/src/socialiq/page/assets/fleet.js";
import { dialOf } from "../../packages/socialiq/src/socialiq/page/assets/network.js";

const [core, layout, file, angle, count, first, last, out] = process.argv.slice(2);
const program = new WebAssembly.Module(readFileSync(core));
const dial = dialOf(new Uint8Array(readFileSync(file)));
const recorder = new Recorder(new Core(program, JSON.parse(readFileSync(layout)), 1, true));
const fleet = new Fleet(recorder, Number(count), [dial.at(dial.low), dial.at(Number(angle))]);
const episodes = [];
for (let seed = Number(first); seed <= Number(last); seed += 1) {
  fleet.begin(seed);
  while (!fleet.over) {
    fleet.decide();
    fleet.settle();
  }
  episodes.push({ endings: fleet.film.endings, decisions: fleet.film.decisions.length });
}
writeFileSync(out, JSON.stringify({ episodes, counts: fleet.counts, seconds: fleet.seconds }));
