// Episodes driven by the page's dial, written as it downloads them: `... CORE DATA DIAL OUT`.

import { readFileSync, writeFileSync } from "node:fs";
import { Core } from "../../packages/socialiq/src/socialiq/page/assets/core.js";
import { demonstrationsFile } from "../../packages/socialiq/src/socialiq/page/assets/demonstrations.js";
import { Recorder, filmOf } from "../../packages/socialiq/src/socialiq/page/assets/film.js";
import { dialOf } from "../../packages/socialiq/src/socialiq/page/assets/network.js";

const [core, data, dial, out] = process.argv.slice(2);
const layout = JSON.parse(readFileSync(data));
const recorder = new Recorder(new Core(new WebAssembly.Module(readFileSync(core)), layout, 1, true));
const network = dialOf(new Uint8Array(readFileSync(dial))).at(45);
const films = [1, 2, 3].map((seed) => filmOf(recorder, network, seed));
writeFileSync(out, demonstrationsFile(films, layout));
