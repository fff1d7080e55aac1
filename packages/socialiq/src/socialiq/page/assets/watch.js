// Episodes of an audit's report, replayed from their decisions by the compiled core.

import { coloursOf } from "./colours.js";
import { element, signed } from "./bars.js";
import { Core, bytesOf } from "./core.js";
import { Recorder, filmOfActions, outcomeOf, sumsOf } from "./film.js";
import { Player } from "./player.js";

const CLOSE = 1e-9; // difference of rewards that is called none

/** Return what a replay says beside the report: both rewards, and by how much they differ. */
export function comparison(film, row, layout) {
  const { env, social } = sumsOf(film, film.decisions.length, layout.signals.length);
  const apart = [Math.abs(env - row.r_env), Math.abs(social - row.r_social)];
  const whole = film.decisions.length === row.decisions && film.ending !== layout.endings.none;
  const rewards = `Own progress ${signed(env)}, effect on others ${signed(social)}: `;
  if (!whole) return `${rewards}this browser's episode ${outcomeOf(film, layout)}, the report's has ${row.decisions} decisions and ended by ${row.ending}.`;
  if (Math.max(...apart) <= CLOSE) return `${rewards}as in the report, to 1e-9.`;
  return `${rewards}they differ from the report's by ${apart.map((one) => one.toExponential(1)).join(" and ")}.`;
}

function start() {
  const root = document.getElementById("watch");
  const data = JSON.parse(document.getElementById("watched").textContent);
  const { layout, episodes } = data;
  const recorder = new Recorder(new Core(new WebAssembly.Module(bytesOf(data.core)), layout, 1, true));
  const player = new Player(root.querySelector(".player"), { layout, colours: coloursOf(root), name: "the policy" });
  const compared = root.querySelector(".compared");
  const buttons = episodes.map((row) => {
    const text = `${row.kind} ${row.number}`;
    const button = element("button", { type: "button" }, text, element("small", { textContent: row.ending }));
    button.addEventListener("click", () => choose(row, button));
    return button;
  });
  const choose = (row, button) => {
    buttons.forEach((one) => one.setAttribute("aria-pressed", String(one === button)));
    const film = filmOfActions(recorder, row.seed, [...row.actions].map(Number));
    compared.textContent = comparison(film, row, layout);
    player.load(film);
  };
  root.querySelector(".episodes").replaceChildren(...buttons);
  root.hidden = false;
  choose(episodes[0], buttons[0]);
  player.clock.pause(); // it plays when it is asked to
}

if (typeof document !== "undefined") {
  try {
    start();
  } catch (error) {
    const root = document.getElementById("watch");
    root.replaceChildren(element("p", { className: "blank", textContent: `[ blank ] The episodes can't be replayed here: ${error.message}` }));
    root.hidden = false;
  }
}
