/** The theme, and its colours for the canvases. */

import { byId, icon } from "./dom.js";
import { tell } from "./state.js";

const NAMES = (
  "page floor void grid line edge ink soft accent solid solid-edge wall unknown slow fast body tyre tread " +
  "start goal bad surface w0 w1 w2 w3 w4 w5 w6 w7"
).split(" ");
const THEMES = ["system", "light", "dark"];
const KEPT = "wheelplan-theme";

/** Colours by name as [r, g, b], and as CSS text under `css`. */
export const palette = { rgb: {}, css: {} };

/** Reads the colours in force. A probe resolves light-dark() and var(), which a custom property keeps as text. */
function read() {
  const probe = document.createElement("i");
  document.body.append(probe);
  for (const name of NAMES) {
    probe.style.color = `var(--${name})`;
    const text = getComputedStyle(probe).color;
    palette.css[name] = text;
    palette.rgb[name] = text
      .match(/[\d.]+/g)
      .slice(0, 3)
      .map(Number);
  }
  probe.remove();
}

/** Between two colours: share 0 is the first. */
export function mixed(from, to, share) {
  const a = palette.rgb[from],
    b = palette.rgb[to];
  return `rgb(${a.map((v, i) => Math.round(v + share * (b[i] - v))).join(" ")})`;
}

export function seriesColour(i) {
  return palette.css[`w${i % 8}`];
}

/** Follows the system's theme until the button says otherwise, and remembers what it said. */
export function startTheme() {
  const button = byId("theme");
  let theme = THEMES.includes(stored()) ? stored() : "system";
  const apply = () => {
    document.documentElement.dataset.theme = theme;
    button.replaceChildren(icon(theme));
    button.setAttribute("aria-label", `Theme: ${theme === "system" ? "as the system" : theme}`);
    button.title = button.getAttribute("aria-label");
    read();
    tell("theme");
  };
  button.addEventListener("click", () => {
    theme = THEMES[(THEMES.indexOf(theme) + 1) % THEMES.length];
    try {
      localStorage.setItem(KEPT, theme);
    } catch {
      /* storage may be off: then the choice lasts as long as the page */
    }
    apply();
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", apply);
  apply();
}

function stored() {
  try {
    return localStorage.getItem(KEPT);
  } catch {
    return null;
  }
}
