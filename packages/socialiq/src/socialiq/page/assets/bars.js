// Both rewards of the episode so far, signal by signal, for each twin.

const WORDS = {
  progress: "progress", speed: "speed", step: "time", collision: "collision", arrival: "arrival",
  timeout: "out of time", yielding: "giving way", disruption: "others braking", neighbour_collision: "collision",
};
const MEANINGS = {
  progress: "metres along the route", speed: "share of the highest speed", step: "cost of each decision",
  collision: "the ego collides: replaces the decision's other signals", arrival: "25 m into an exit",
  timeout: "no arrival in 20 s", yielding: "slow near other vehicles, within 20 m",
  disruption: "speed that neighbours lose because of the ego", neighbour_collision: "the vehicle it hits",
};

/** Return a number with its sign and a true minus. */
export function signed(value, digits = 2) {
  const text = Math.abs(value).toFixed(digits);
  if (Number(text) === 0) return text;
  return (value < 0 ? "−" : "+") + text;
}

/** A table of signals by twin; bars grow to the right for a gain and to the left for a loss. */
export class Bars {
  constructor(root, layout) {
    this.root = root;
    this.layout = layout;
    this.cells = [];
  }

  /** Build the table for some twins. */
  build(twins) {
    const { layout } = this;
    const table = element("table", { className: "signals" });
    const head = element("tr", {}, element("th", { scope: "col", textContent: "signal" }));
    for (const { letter, place } of twins) {
      head.append(element("th", { scope: "col" }, element("span", { className: `badge twin-${place}`, textContent: letter })));
    }
    table.append(element("thead", {}, head));
    this.cells = twins.map(() => []);
    this.totals = { env: [], social: [] };
    table.append(this.group("env", "own progress", layout.signals.slice(0, layout.env_signals), 0, twins));
    table.append(this.group("social", "effect on others", layout.signals.slice(layout.env_signals), layout.env_signals, twins));
    this.root.replaceChildren(table);
  }

  group(name, title, signals, first, twins) {
    const body = element("tbody", { className: name });
    const sum = element("tr", { className: "sum" });
    const symbol = element("span", { className: "symbol", textContent: name === "env" ? "R_env" : "R_social" });
    sum.append(element("th", { scope: "row" }, title, " ", symbol));
    for (const { place } of twins) sum.append(this.cell(this.totals[name], place));
    body.append(sum);
    signals.forEach((signal, number) => {
      const row = element("tr", {}, element("th", { scope: "row", textContent: WORDS[signal], title: MEANINGS[signal] }));
      twins.forEach(({ place }, twin) => {
        const list = this.cells[twin];
        const holder = [];
        row.append(this.cell(holder, place));
        list[first + number] = holder[0];
      });
      body.append(row);
    });
    return body;
  }

  cell(list, place) {
    const bar = element("span", { className: `bar twin-${place}` });
    const value = element("span", { className: "value", textContent: "0.00" });
    list.push({ bar, value });
    const amount = element("span", { className: "amount" }, element("span", { className: "track" }, bar), value);
    return element("td", {}, amount);
  }

  /** Show the sums of each twin, of `film.sumsOf`. */
  show(sums) {
    sums.forEach((one, twin) => {
      set(this.totals.env[twin], one.env);
      set(this.totals.social[twin], one.social);
      one.signals.forEach((value, number) => set(this.cells[twin][number], value));
    });
  }
}

const WHOLE = 10; // reward of a bar that fills its half

function set({ bar, value }, amount) {
  const share = Math.min(Math.abs(amount) / WHOLE, 1) * 50;
  bar.style.width = `${share}%`;
  bar.style.left = amount < 0 ? `${50 - share}%` : "50%";
  bar.classList.toggle("loss", amount < 0);
  value.textContent = signed(amount);
}

/** Return an element with properties and children; strings become text. */
export function element(name, properties = {}, ...children) {
  const made = document.createElement(name);
  const { dataset, ...plain } = properties;
  Object.assign(made, plain);
  Object.assign(made.dataset, dataset);
  made.append(...children);
  return made;
}
