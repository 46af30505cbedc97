/** Play, pause, speed, the scrubber and the clock. */

import { byId, element, icon } from "./dom.js";
import { fixed } from "./format.js";
import { pause, player, seek, SPEEDS, toggle } from "./player.js";
import { on, state } from "./state.js";

export function startTransport() {
  byId("play").addEventListener("click", toggle);
  const scrub = byId("scrub");
  scrub.addEventListener("input", () => {
    pause();
    seek(scrub.valueAsNumber);
  });
  scrub.addEventListener("keydown", step);
  for (const speed of SPEEDS) byId("speeds").append(speedButton(speed));
  on("player", showState);
  on("time", showTime);
  on("motion", () => {
    scrub.max = state.motion?.duration ?? 1;
    showTime();
    showState();
  });
  document.addEventListener("keydown", (event) => {
    if (
      event.key !== " " ||
      event.defaultPrevented ||
      event.target.matches("input, textarea, select, button, summary, a, pre")
    )
      return;
    event.preventDefault();
    toggle();
  });
  showState();
}

function speedButton(speed) {
  const input = element("input", {
    type: "radio",
    name: "speed",
    value: speed,
    checked: speed === player.speed,
  });
  input.addEventListener("change", () => (player.speed = speed));
  return element("label", {}, input, element("span", {}, `${speed}×`));
}

/** Arrows go by a tenth of a second, with Shift or Page keys by one; Home and End to the ends; space plays. */
function step(event) {
  const by = event.shiftKey ? 1 : 0.1;
  const go = {
    ArrowLeft: player.time - by,
    ArrowDown: player.time - by,
    ArrowRight: player.time + by,
    ArrowUp: player.time + by,
    PageDown: player.time - 1,
    PageUp: player.time + 1,
    Home: 0,
    End: Infinity,
  }[event.key];
  if (event.key === " ") toggle();
  else if (go === undefined) return;
  else {
    pause();
    seek(go);
  }
  event.preventDefault();
}

function showState() {
  const button = byId("play");
  if (button.dataset.playing === String(player.playing)) return;
  button.dataset.playing = player.playing;
  button.replaceChildren(icon(player.playing ? "pause" : "play"));
  button.setAttribute("aria-label", player.playing ? "Pause" : "Play");
}

function showTime() {
  if (!state.motion) return;
  const { duration } = state.motion;
  const scrub = byId("scrub");
  scrub.value = player.time;
  scrub.style.setProperty("--share", duration ? player.time / duration : 0);
  scrub.setAttribute("aria-valuetext", `${fixed(player.time, 2)} of ${fixed(duration, 2)} seconds`);
  byId("clock").textContent = `${fixed(player.time, 2)} / ${fixed(duration, 2)} s`;
}
