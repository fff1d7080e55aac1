// Replay decisions in the compiled core, in Node: `node replay.mjs CORE LAYOUT JOB OUT`.
//
// JOB holds the seeds of the episodes and the decisions of each step, -1 where an episode has ended,
// or an agent of it: those of several agents are a list.
// OUT gets, for the reset and after each step, the arrays of `kept` as they are in memory.

import { readFileSync, writeFileSync, appendFileSync } from "node:fs";
import { Core } from "../../packages/socialiq/src/socialiq/page/assets/core.js";

const [core, layout, job, out] = process.argv.slice(2);
const { seeds, decisions, kept } = JSON.parse(readFileSync(job));
const module = new WebAssembly.Module(readFileSync(core));
const episodes = new Core(module, JSON.parse(readFileSync(layout)), seeds.length, false);

function write() {
  for (const name of kept) {
    const array = episodes.arrays[name];
    appendFileSync(out, new Uint8Array(array.buffer, array.byteOffset, array.byteLength));
  }
}

writeFileSync(out, "");
seeds.forEach((seed, row) => episodes.begin(row, seed));
episodes.run();
write();
for (const actions of decisions) {
  actions.map((action) => [action].flat()).forEach((ofAgents, row) => {
    if (Math.max(...ofAgents) < 0) episodes.skip(row);
    else episodes.decide(row, ...ofAgents.map((action) => Math.max(action, 0)));
  });
  episodes.run();
  write();
}
