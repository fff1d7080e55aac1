// Decisions per second of the processor, by the compiled core in Node: `node rate.mjs CORE LAYOUT ROWS DECISIONS`.

import { readFileSync } from "node:fs";
import { Core } from "../packages/socialiq/src/socialiq/page/assets/core.js";

const [core, layout, rows, decisions] = process.argv.slice(2);
const module = new WebAssembly.Module(readFileSync(core));
const episodes = new Core(module, JSON.parse(readFileSync(layout)), Number(rows), false);
const command = episodes.layout.commands.decide_and_reset;
const rounds = Math.ceil(Number(decisions) / episodes.rows);
const actions = Array.from({ length: rounds * episodes.rows }, () => Math.floor(3 * Math.random()));

function round(number) {
  for (let row = 0; row < episodes.rows; row += 1) {
    episodes.decide(row, actions[number * episodes.rows + row]);
    episodes.arrays.commands[row] = command;
  }
  episodes.run();
}

for (let row = 0; row < episodes.rows; row += 1) episodes.begin(row, row);
episodes.run();
for (let number = 0; number < Math.min(rounds, 50); number += 1) round(number); // until it is compiled
const begun = process.cpuUsage();
for (let number = 0; number < rounds; number += 1) round(number);
const { user, system } = process.cpuUsage(begun);
console.log((1e6 * rounds * episodes.rows) / (user + system));
