// Colours of the style sheet, for canvases.

const PLAIN = ["ground", "road", "curb", "marking", "other", "edge", "glass", "alarm", "yields", "ghost", "person", "lane"];

/** Return a function that returns the colours of an element's scheme; the same object until they change. */
export function coloursOf(root = document.documentElement) {
  let known;
  let scheme;
  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  return () => {
    if (known && scheme === dark.matches) return known;
    scheme = dark.matches;
    const style = getComputedStyle(root);
    const colour = (name) => style.getPropertyValue(`--${name}`).trim();
    known = Object.fromEntries(PLAIN.map((name) => [name, colour(name)]));
    known.onEgo = colour("on-ego");
    known.twins = [0, 1, 2].map((place) => colour(`twin-${place}`));
    return known;
  };
}
