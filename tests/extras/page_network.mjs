// Decision and values of the page's network, float64: `node page_network.mjs DIAL OBSERVATIONS ANGLE FEATURES OUT`.
// With a clock the time is the last feature.

import { readFileSync, writeFileSync } from "node:fs";
import { dialOf } from "../../packages/socialiq/src/socialiq/page/assets/network.js";

const [dial, observations, angle, features, out] = process.argv.slice(2);
const bytes = readFileSync(observations);
const seen = new Float32Array(bytes.buffer, bytes.byteOffset, bytes.length / 4);
const network = dialOf(new Uint8Array(readFileSync(dial))).at(Number(angle));
const width = Number(features);
const shown = width - (width % 7); // without the time
const answers = Array.from({ length: seen.length / width }, (_, row) => {
  const first = row * width;
  const observed = [seen.subarray(first, first + shown), width > shown ? seen[first + shown] : 0];
  return [network.decide(...observed), ...network.values(...observed)];
});
writeFileSync(out, Float64Array.from(answers.flat()));
