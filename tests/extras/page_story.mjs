// What the page says of its dials: `node page_story.mjs CORE LAYOUT NEAR CAUSED CURVE SEED OUT`. OUT gets what the story shows
// of a seed, the angles that decide as the dial itself does, and the angles that its own episodes don't exclude.

import { readFileSync, writeFileSync } from "node:fs";
import { Core } from "../../packages/socialiq/src/socialiq/page/assets/core.js";
import { episodesOf } from "../../packages/socialiq/src/socialiq/page/assets/episodes.js";
import { Recorder, filmOf } from "../../packages/socialiq/src/socialiq/page/assets/film.js";
import { agreements, likeliest } from "../../packages/socialiq/src/socialiq/page/assets/likeness.js";
import { momentsOf } from "../../packages/socialiq/src/socialiq/page/assets/moments.js";
import { dialOf } from "../../packages/socialiq/src/socialiq/page/assets/network.js";
import { notExcluded } from "../../packages/socialiq/src/socialiq/page/assets/sold.js";

const [core, layoutFile, near, caused, curveFile, seed, out] = process.argv.slice(2);
const layout = JSON.parse(readFileSync(layoutFile));
const module = new WebAssembly.Module(readFileSync(core));
const recorder = new Recorder(new Core(module, layout, 1, true));
const dials = [near, caused].map((file) => dialOf(new Uint8Array(readFileSync(file))));
const curve = JSON.parse(readFileSync(curveFile));

const film = (dial, angle, number = Number(seed)) => filmOf(recorder, dials[dial].at(angle), number);
const [own, even, standing, going] = [film(1, 0), film(1, 45), film(0, 90), film(1, 90)];
const story = [[own, even], [even, own], [standing, going], [going, standing]].map(([one, other]) => momentsOf(one, other, layout).summary);

const angles = Array.from({ length: 91 }, (_, angle) => angle);
const networks = angles.map((angle) => dials[0].at(angle));
const likeness = [0, 30, 45, 60, 85].map((angle) => {
  const films = [101, 102, 103, 104, 105, 106].map((number) => film(0, angle, number));
  return { angle, ...likeliest(agreements(films, networks), films.reduce((sum, one) => sum + one.decisions.length, 0)) };
});

const many = new Core(module, layout, 50, false);
const excluded = [0, 45, 75].map((angle) => {
  const blocks = Array.from({ length: 8 }, (_, block) => Array.from({ length: 500 }, (__, number) => 20_001 + 500 * block + number));
  return { angle, accepted: blocks.map((seeds) => notExcluded(episodesOf(many, dials[0].at(angle), seeds), curve)) };
});
writeFileSync(out, JSON.stringify({ story, likeness, excluded }));
