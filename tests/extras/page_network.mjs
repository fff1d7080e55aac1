// Decisions of the page's network: `node page_network.mjs DIAL OBSERVATIONS ANGLE FEATURES OUT`.

import { readFileSync, writeFileSync } from "node:fs";
import { dialOf } from "../../src/socialiq/page/assets/network.js";

const [dial, observations, angle, features, out] = process.argv.slice(2);
const bytes = readFileSync(observations);
const seen = new Float32Array(bytes.buffer, bytes.byteOffset, bytes.length / 4);
const network = dialOf(new Uint8Array(readFileSync(dial))).at(Number(angle));
const width = Number(features);
const decided = Uint8Array.from({ length: seen.length / width }, (_, row) => network.decide(seen.subarray(row * width, (row + 1) * width)));
writeFileSync(out, decided);
