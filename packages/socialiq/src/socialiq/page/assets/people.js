// People on foot and on bicycles: the same episode, driven by an altruist that weighs vehicles alone and by one that weighs people.

import { Beside } from "./beside.js";
import { filmOfActions, outcomeOf } from "./film.js";

const AROUND = { reach: 32, south: 3 }; // m; the crosswalks and the bicycle lanes before them
const NAMES = ["weighs vehicles alone", "weighs people alone"];

/** Return what people lost by waiting for the car up to a frame, in words. */
function waits(film, frame, classes) {
  const { waited } = film.frames[frame];
  return `Seconds for which others wait for it: ${classes.map((name, kind) => `${name} ${waited[kind].toFixed(1)}`).join(", ")}`;
}

/**
 * Return the tab.
 *
 * @param {object} parts `{ layout, seed, angle, drivers, recorder, colours }`: of `page.people`; `recorder` makes one.
 */
export function peopleTab({ layout, seed, angle, drivers, recorder, colours }) {
  document.getElementById("people-angle").textContent = `${angle}°`;
  document.getElementById("people-seed").textContent = `seed ${seed}`;
  const { classes } = layout.people;
  const scenes = () => {
    const recorded = recorder();
    return drivers.map(({ actions }, place) => {
      const film = filmOfActions(recorded, seed, actions);
      const last = film.frames.length - 1;
      const said = (frame) => waits(film, frame, classes) + (frame === last ? `; it ${outcomeOf(film, layout)}` : "");
      return { title: `The car ${NAMES[place]}`, place, film, said, label: waits(film, last, classes) };
    });
  };
  return new Beside("people", { layout, colours, extent: AROUND, scenes });
}
