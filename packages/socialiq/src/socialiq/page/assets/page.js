// The page's start: opens the core and the dial, shows the tabs, and answers as its own worker.

import { FIRST, readAddress, writeAddress } from "./address.js";
import { coloursOf } from "./colours.js";
import { Core, bytesOf } from "./core.js";
import { Crossing } from "./crossing.js";
import { Driving } from "./driving.js";
import { answer } from "./episodes.js";
import { Recorder } from "./film.js";
import { Fleets } from "./fleet.js";
import { lateTab } from "./late.js";
import { dialOf } from "./network.js";
import { UserError } from "./safetensors.js";
import { Sold } from "./sold.js";
import { peopleTab } from "./people.js";
import { Story } from "./story.js";
import { Twins } from "./twins.js";

const TABS = ["story", "drive", "sold", "turn", "grid", "fleet", "people", "late", "about"];
const NARROW = 640; // CSS pixels below which twins share one scene, unless a link says otherwise

/** Return the core with some rows, and the dial, from the page's data. */
function open({ core, layout, dial }, rows) {
  const module = new WebAssembly.Module(bytesOf(core));
  return { core: new Core(module, layout, rows, false), dial: dialOf(bytesOf(dial)) };
}

/** Return a function that asks a worker; the worker runs this same program. */
function workerOf(data) {
  let worker;
  let asked = 0;
  const waiting = new Map();
  const start = () => {
    const program = document.getElementById("program").textContent;
    const place = URL.createObjectURL(new Blob([program], { type: "text/javascript" }));
    worker = new Worker(place);
    worker.onmessage = ({ data: { number, found, fault } }) => {
      const { resolve, reject } = waiting.get(number);
      waiting.delete(number);
      if (fault) reject(new UserError(fault));
      else resolve(found);
    };
    worker.onerror = () => waiting.forEach(({ reject }) => reject(new UserError("this browser runs nothing in the background here")));
    worker.postMessage({ open: data });
  };
  return (question) =>
    new Promise((resolve, reject) => {
      if (!worker) start();
      waiting.set((asked += 1), { resolve, reject });
      worker.postMessage({ ...question, number: asked });
    });
}

function showTab(name, state) {
  state.tab = name;
  for (const one of TABS) {
    const chosen = one === name;
    document.getElementById(one).hidden = !chosen;
    const tab = document.getElementById(`tab-${one}`);
    tab.setAttribute("aria-selected", String(chosen));
    tab.tabIndex = chosen ? 0 : -1;
  }
}

function listen({ story, twins, driving, crossing, fleets, people, late }, state) {
  const parts = { story, turn: twins, drive: driving, grid: crossing, fleet: fleets, people, late };
  const tabs = TABS.map((name) => document.getElementById(`tab-${name}`));
  tabs.forEach((tab, number) => {
    tab.addEventListener("click", () => show(TABS[number]));
    tab.addEventListener("keydown", (event) => {
      const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
      if (!step) return;
      const next = (number + step + TABS.length) % TABS.length;
      tabs[next].focus();
      show(TABS[next]);
      event.stopPropagation();
    });
  });
  function show(name) {
    twins.clock.pause();
    for (const part of [story, driving, fleets, people, late]) part.pause();
    showTab(name, state);
    window.history.replaceState(null, "", writeAddress(state));
    parts[name]?.show();
  }
  document.addEventListener("keydown", (event) => {
    if (event.target.closest("input, select, textarea") || event.metaKey || event.ctrlKey || event.altKey) return;
    const keys = { story: () => story.key(event), drive: () => driving.key(event), turn: () => keyOf(event, twins), grid: () => crossing.key(event), fleet: () => fleets.key(event), people: () => people.key(event), late: () => late.key(event) };
    if (keys[state.tab]?.()) event.preventDefault();
  });
  window.addEventListener("hashchange", () => window.location.reload());
  new ResizeObserver(() => parts[state.tab]?.show()).observe(document.querySelector("main"));
  window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => parts[state.tab]?.show());
}

/** Keys of the first tab; return whether one was meant. */
function keyOf(event, twins) {
  const { clock, layout, state } = twins;
  const acts = {
    " ": () => (clock.playing ? clock.pause() : clock.play()),
    ".": () => clock.step(1, layout.frames), ",": () => clock.step(-1, layout.frames),
    n: () => twins.toSeed(state.seed + 1),
  };
  state.angles.forEach((_, place) => (acts[String(place + 1)] = () => twins.choose(place)));
  const onButton = event.target.closest("button, a") && event.key === " ";
  if (event.key in acts && !onButton) acts[event.key]();
  else if (event.key.startsWith("Arrow")) twins.knob.key(event);
  else return false;
  return !onButton;
}

/** Offer the dials with a curve by what they were rewarded for; the page opens again with the one that is chosen. */
function offer(all, state) {
  const dials = all.filter(({ curve }) => curve.length);
  const select = document.getElementById("rewarded");
  select.replaceChildren(...dials.map(({ name }, number) => new Option(name, number, false, number === state.dial)));
  select.parentElement.hidden = dials.length < 2;
  select.addEventListener("change", () => { window.location.hash = writeAddress({ ...state, dial: Number(select.value) }); });
}

function fail(message) {
  const line = document.getElementById("fault");
  line.textContent = message;
  line.hidden = false;
  document.querySelector("main").hidden = true;
}

function start() {
  if (typeof WebAssembly !== "object") {
    fail("This browser has no WebAssembly, which the simulator needs: use a current browser.");
    return;
  }
  try {
    const data = JSON.parse(document.getElementById("data").textContent);
    const state = readAddress(window.location.hash, data.dials.map(({ range }) => range));
    const chosen = data.dials[state.dial];
    const shared = { core: data.core, layout: data.layout, dial: chosen.dial };
    const { dial } = open(shared, 1);
    const module = new WebAssembly.Module(bytesOf(data.core));
    const recorder = (layout = data.layout) => new Recorder(new Core(module, layout, 1, true));
    if (!window.location.hash && window.innerWidth < NARROW) state.view = "ghosts";
    const parts = {
      layout: data.layout, dial, range: chosen.range, curve: chosen.curve,
      background: workerOf(shared), colours: coloursOf(),
    };
    offer(data.dials, state);
    showTab(state.tab, state);
    const twins = new Twins({ ...parts, recorder: recorder() }, state);
    const driving = new Driving({ ...parts, recorder: recorder() }, state);
    const crossing = new Crossing(data.crossing, state);
    const dials = data.dials.map(({ name, range, dial: text }) => ({ name, range, bytes: () => bytesOf(text) }));
    const several = { ...data.layout, ...data.fleet.layout };
    const fleets = new Fleets({ ...data.fleet, layout: several, dials, recorder: () => recorder(several), colours: parts.colours }, state);
    const sold = new Sold(parts);
    const story = new Story({ layout: data.layout, recorder: recorder(), dials, story: data.story, colours: parts.colours }, state);
    story.show();
    const crossed = { ...data.layout, ...data.people.layout };
    const people = peopleTab({ ...data.people, layout: crossed, recorder: () => recorder(crossed), colours: parts.colours });
    const late = lateTab({ layout: data.layout, dial: dialOf(dials[0].bytes()), shares: data.late, recorder, colours: parts.colours, state });
    for (const part of [people, late]) part.show();
    listen({ story, twins, driving, crossing, fleets, people, late }, state);
    const still = window.matchMedia("(prefers-reduced-motion: reduce)").matches;
    if (state.tab === "turn" && state.step === FIRST.step && !still) twins.clock.play();
    document.documentElement.dataset.ready = "yes";
    performance.mark("ready");
    Object.assign(window, { story, sold, twins, driving, crossing, fleets, people, late }); // for tests and the curious
  } catch (error) {
    fail(error instanceof UserError ? error.message : `This page can't start: ${error.message}`);
  }
}

if (typeof document === "undefined") {
  if (typeof self !== "undefined") answer(open);
} else start();
