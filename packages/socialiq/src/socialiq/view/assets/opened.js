// The page of something of the user's: opens what its server sent, or says in one line why not.

import { coloursOf } from "../../page/assets/colours.js";
import { bytesOf } from "../../page/assets/core.js";
import { dialOf } from "../../page/assets/network.js";
import { Compared } from "./compared.js";
import { Replayed } from "./replayed.js";
import { Traffic } from "./traffic.js";

const KINDS = { policy: Compared, episodes: Replayed, traffic: Traffic };

/** Show one line; what is on the page stays as it is. */
function complain(line) {
  const place = document.getElementById("fault");
  place.textContent = line;
  place.hidden = false;
}

function fail(line) {
  complain(line);
  document.querySelector("main").hidden = true;
}

function start() {
  if (typeof WebAssembly !== "object") {
    fail("This browser has no WebAssembly, which the simulator needs: use a current browser.");
    return;
  }
  try {
    const { core, dial, layout, curve, range, shown } = JSON.parse(document.getElementById("data").textContent);
    const module = new WebAssembly.Module(bytesOf(core));
    const parts = { module, layout, curve, range, dial: dialOf(bytesOf(dial)), colours: coloursOf(), complain };
    window.opened = new KINDS[shown.kind](parts, shown); // for tests and the curious
  } catch (error) {
    fail(`This page can't start: ${error.message}`);
  }
}

start();
