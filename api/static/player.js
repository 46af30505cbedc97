/** The clock of the plan in view: play, pause, scrub, at a chosen speed. */

import { on, state, tell } from "./state.js";

export const SPEEDS = [0.25, 0.5, 1, 2, 4, 8];

export const player = { time: 0, playing: false, speed: 1 };

/** A frame that comes later, because the page was out of sight, counts as this many seconds. */
const LONGEST = 0.1;

let last = 0;

on("motion", () => {
  if (!state.motion) pause();
});

export function play() {
  if (!state.motion?.duration) return;
  if (player.time >= state.motion.duration) player.time = 0;
  player.playing = true;
  last = performance.now();
  tell("player");
  requestAnimationFrame(tick);
}

export function pause() {
  player.playing = false;
  tell("player");
}

export function toggle() {
  if (player.playing) pause();
  else play();
}

/** Goes to a time, s. */
export function seek(time) {
  player.time = Math.min(state.motion?.duration ?? 0, Math.max(0, time));
  tell("time");
}

function tick(now) {
  if (!player.playing) return;
  const step = Math.min(LONGEST, Math.max(0, now - last) / 1e3);
  last = now;
  seek(player.time + player.speed * step);
  if (player.time >= state.motion.duration) pause();
  else requestAnimationFrame(tick);
}
