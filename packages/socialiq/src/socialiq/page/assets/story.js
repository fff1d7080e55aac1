// The first tab: one question, then five steps, each with one control and one sentence.

import { keepAddress } from "./address.js";
import { filmOf, outcomeOf, sceneAt } from "./film.js";
import { Knob } from "./knob.js";
import { dialOf } from "./network.js";
import { Price } from "./price.js";
import { staged } from "./scene.js";
import { crossingTimes, hardBrakings, momentsOf } from "./moments.js";
import { Transport } from "./transport.js";

const [SLOWER, , FASTER] = [0, 1, 2];
const BEFORE = 2; // s shown before the question is asked
const HELD = 3; // decisions that the visitor's choice holds
const ON_AT = 45; // degrees at which the network drives on after it
const BLUE = 0, ORANGE = 1, GREEN = 2; // places of the colours, as of twins

/** Drive as the network does, but for some decisions that the visitor chose. */
function filmOfChoice(recorder, network, seed, first, action) {
  const film = recorder.begin(seed);
  let more = true;
  while (more) {
    const now = film.decisions.length;
    const chosen = now >= first && now < first + HELD ? action : network.decide(recorder.observation, now);
    more = recorder.decide(chosen);
  }
  return film;
}

/** Return the decision before which the question is asked: the last that is taken before the first car enters the crossing. */
export function questionAt(film, layout) {
  return Math.max(Math.floor(crossingTimes(film).ego / layout.frames) - HELD, 1);
}

export class Story {
  /**
   * @param {object} parts `{ layout, recorder, dials, story, colours }`; `story` of `page.data.story`.
   * @param {object} state Of `address.readAddress`; `step` of the story is its `chapter`.
   */
  constructor(parts, state) {
    Object.assign(this, parts);
    this.state = state;
    this.seed = this.story.seed;
    this.find = (name) => document.getElementById(`story-${name}`);
    this.opened = new Map();
    this.clock = new Transport(this.layout.frames / this.layout.decision_seconds, () => this.draw());
    const [low, high] = this.dials[this.story.main].range;
    this.knob = new Knob(this.find("dial"), [low, high], (angle) => this.turn(angle));
    this.price = this.story.price.length ? new Price(this.find("price"), this.story.price) : null;
    this.asked = Math.min(Math.max(60, low), high);
    this.chapters = this.allChapters().filter(Boolean);
    this.find("back").addEventListener("click", () => this.go(this.state.chapter - 1));
    this.find("on").addEventListener("click", () => this.go(this.state.chapter + 1));
    this.find("again").addEventListener("click", () => (this.clock.playing ? this.clock.pause() : this.again()));
    this.find("go").addEventListener("click", () => this.choose(FASTER));
    this.find("wait").addEventListener("click", () => this.choose(SLOWER));
    this.state.chapter = Math.min(this.state.chapter, this.chapters.length - 1);
  }

  network(angle, dial = this.story.main) {
    if (!this.opened.has(dial)) this.opened.set(dial, dialOf(this.dials[dial].bytes()));
    const { low, high } = this.opened.get(dial);
    return this.opened.get(dial).at(Math.min(Math.max(angle, low), high));
  }

  film(angle, dial) {
    return filmOf(this.recorder, this.network(angle, dial), this.seed);
  }

  /** The chapters: words, and the scenes, each `{ title, place, film, beside }`; `beside` is the film it is compared with. */
  allChapters() {
    const { main, other } = this.story;
    const two = (angle, place, film, beside, title = `${angle}°`) => ({ title, place, film, beside });
    return [
      { name: "ask", title: "You are the green car and turn left. Do you let the others pass?", scenes: () => this.question() },
      {
        name: "selfish", title: "0°: it drives for itself.",
        words: "A car that only counts its own progress takes the first gap. Another car has to brake.",
        scenes: () => { const [own, even] = [this.film(0), this.film(45)]; return [two(0, BLUE, own, even)]; },
      },
      {
        name: "polite", title: "45°: the others count as much as itself.",
        words: "The same traffic, one number changed. It lets others pass, and arrives.",
        scenes: () => { const [own, even] = [this.film(0), this.film(45)]; return [two(0, BLUE, own, even), two(45, ORANGE, even, own)]; },
      },
      other === null ? null : {
        name: "too-polite", title: "90°: only the others count. Is that polite?",
        words: "It depends on what it is told to count. Left: what happens near it, so it never goes, and the cars behind it wait, too. Right: what it causes. That car goes.",
        scenes: () => {
          const [near, caused] = [this.film(90, other), this.film(90)];
          return [two(90, BLUE, near, caused, "90°, what happens near it"), two(90, GREEN, caused, near, "90°, what it causes")];
        },
      },
      this.price && { name: "price", title: "What an angle costs the others.", words: this.price.words, scenes: () => [] },
      {
        name: "turn", title: "Now turn it.", words: "The network is the same at every angle. Only the number changes.",
        scenes: () => {
          const [own, chosen] = [this.film(0), this.film(this.asked)];
          return [two(0, BLUE, own, chosen), two(this.asked, ORANGE, chosen, own)];
        },
      },
    ];
  }

  /** The question, and once it is answered the same seconds at 0 and 45 degrees beside the visitor's. */
  question() {
    const [own, even] = [this.film(0), this.film(ON_AT)];
    this.first = questionAt(own, this.layout);
    if (this.answer === undefined) return [{ title: "you", place: GREEN, film: even, beside: even }];
    const yours = filmOfChoice(this.recorder, this.network(ON_AT), this.seed, this.first, this.answer);
    return [
      { title: "you", place: GREEN, film: yours, beside: this.answer === FASTER ? even : own },
      { title: "0°, for itself", place: BLUE, film: own, beside: even },
      { title: "45°, for both", place: ORANGE, film: even, beside: own },
    ];
  }

  choose(action) {
    this.answer = action;
    this.show(true);
    this.clock.time = Math.max((this.first - BEFORE) * this.layout.frames, 0);
    this.play();
  }

  turn(angle) {
    this.asked = angle;
    const { time } = this.clock;
    this.show(true);
    this.clock.time = Math.min(time, this.clock.end);
    this.draw();
  }

  go(chapter) {
    this.state.chapter = Math.min(Math.max(chapter, 0), this.chapters.length - 1);
    this.answer = undefined;
    this.show(true);
    this.again();
    this.find("title").focus({ preventScroll: true });
    keepAddress(this.state);
  }

  get chapter() {
    return this.chapters[this.state.chapter];
  }

  get asking() {
    return this.chapter.name === "ask" && this.answer === undefined;
  }

  again() {
    this.clock.time = this.chapter.name === "ask" && !this.asking ? Math.max((this.first - BEFORE) * this.layout.frames, 0) : 0;
    if (this.chapter.name === "price") this.price.begin();
    else this.play();
  }

  /** Play, or where less motion is wanted show the end: of the question the moment at which it is asked. */
  play() {
    if (window.matchMedia("(prefers-reduced-motion: reduce)").matches) this.clock.seek(this.clock.end);
    else this.clock.play();
  }

  pause() {
    if (this.clock.playing) this.clock.pause();
  }

  key(event) {
    if (event.target.closest("button, select") && event.key === " ") return false;
    if (this.chapter.name === "turn" && event.key.startsWith("Arrow")) this.knob.key(event);
    else if (event.key === "ArrowRight") this.go(this.state.chapter + 1);
    else if (event.key === "ArrowLeft") this.go(this.state.chapter - 1);
    else if (event.key === " ") this.find("again").click();
    else return false;
    return true;
  }

  /** Build the chapter's scenes, unless they stand already, and draw. */
  show(changed = false) {
    if (document.getElementById("story").hidden) return;
    if (changed || this.shown !== this.state.chapter) this.build();
    this.draw();
  }

  build() {
    const { chapter, layout } = this;
    const first = this.shown === undefined;
    this.shown = this.state.chapter;
    this.scenes = chapter.scenes().map((scene) => this.sceneOf(scene));
    const frames = (films) => Math.max(0, ...films.map(({ film }) => film.frames.length - 1));
    this.clock.load(this.asking ? this.first * layout.frames : frames(this.scenes));
    this.find("stages").replaceChildren(...this.scenes.map(({ figure }) => figure));
    this.find("stages").dataset.count = this.scenes.length;
    this.find("title").textContent = chapter.title;
    this.find("words").textContent = chapter.words ?? "";
    this.find("steps").textContent = this.state.chapter ? `Step ${this.state.chapter} of ${this.chapters.length - 1}` : "One question first";
    document.getElementById("story").dataset.chapter = chapter.name;
    const visible = {
      back: this.state.chapter > 0, on: !this.asking && this.state.chapter < this.chapters.length - 1, again: !this.asking,
      choice: this.asking, turning: chapter.name === "turn", price: chapter.name === "price", stages: this.scenes.length > 0,
      braked: this.scenes.some(({ hard, spared }) => [...hard.keys()].some((identity) => !spared.has(identity))) && !this.asking,
    };
    for (const [name, value] of Object.entries(visible)) this.find(name).toggleAttribute("hidden", !value);
    this.find("on").textContent = this.state.chapter ? "Next" : "Who drives at 0° and 45°?";
    if (chapter.name === "turn") this.knob.show([{ angle: this.asked, letter: "", place: ORANGE }], 0);
    if (first) this.again();
  }

  sceneOf({ title, place, film, beside }) {
    const label = `Crossing seen from above, ${title}: the car ${outcomeOf(film, this.layout)}`;
    return { film, place, moments: momentsOf(film, beside, this.layout), hard: hardBrakings(film), spared: hardBrakings(beside), ...staged({ title, place, live: true }, label, this.layout) };
  }

  /** What came of the visitor's choice, beside the other two, once it is seen. */
  tell() {
    const { clock } = this;
    const words = clock.time < clock.end ? `Your choice holds for ${HELD} seconds, then the network drives on.` : this.verdict();
    if (this.find("words").textContent !== words) this.find("words").textContent = words;
  }

  verdict() {
    const [yours, own, even] = this.scenes.map((scene) => scene.moments.summary);
    const you = yours.replace(/\b(let|make|arrive|collide|wait)s\b/g, "$1");
    return `You ${you}. At 0° the car ${own}; at 45° it ${even}.`;
  }

  draw() {
    if (document.getElementById("story").hidden) return;
    const { clock } = this;
    const colours = this.colours();
    for (const { film, place, caption, moments, hard, spared, stage } of this.scenes) {
      stage.fit(colours);
      const { vehicles, frame } = sceneAt(film, clock.time);
      const braking = new Set([...hard].filter(([identity, [from, to]]) => !spared.has(identity) && frame >= from && frame <= to + this.layout.frames).map(([identity]) => identity));
      const braked = new Set([...hard].filter(([identity, [from]]) => !spared.has(identity) && frame >= from).map(([identity]) => identity));
      stage.draw(vehicles, { letter: "", colour: colours.twins[place], braking, braked, near: false }, []);
      const text = moments.at(frame);
      if (caption.textContent !== text) caption.textContent = text;
    }
    if (this.answer !== undefined) this.tell();
    this.find("again").textContent = clock.playing ? "Pause" : "Play again";
    this.find("choice").classList.toggle("due", this.asking && !clock.playing);
  }
}
