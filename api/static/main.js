/** The page: what the service offers is fetched, the parts are started, and "Plan" plans. */

import { getJson, plan } from "./client.js";
import { startCharts } from "./charts.js";
import { byId, element } from "./dom.js";
import { EXAMPLE } from "./example.js";
import { offerFormats, startExport } from "./export.js";
import { fit, startFloor } from "./floor.js";
import { fixed } from "./format.js";
import { startGrips } from "./grips.js";
import { linked } from "./link.js";
import { Motion } from "./motion.js";
import { startTheme } from "./palette.js";
import { startPanel } from "./panel.js";
import { play, player } from "./player.js";
import { complain, startProblems } from "./problems.js";
import { startResult } from "./result.js";
import { on, state, tell, undo } from "./state.js";
import { startTools } from "./tools.js";
import { startTransport } from "./transport.js";

/** How long a plan takes before one may want to stop it, ms. */
const PATIENCE = 500;

let running = null,
  patience = 0;

async function start() {
  for (const begin of [
    startTheme,
    startProblems,
    startPanel,
    startFloor,
    startGrips,
    startTools,
    startTransport,
    startResult,
    startCharts,
    startExport,
  ])
    begin();
  on("announce", (text) => (byId("said").textContent = text));
  on("settled", () => byId("live").checked && submit());
  byId("live").addEventListener("change", () => tell("settled"));
  byId("plan").addEventListener("click", submit);
  byId("stop").addEventListener("click", () => running?.abort());
  byId("setup").addEventListener("change", () => tell("settled"));
  document.addEventListener("keydown", (event) => {
    if (event.key === "z" && (event.ctrlKey || event.metaKey) && !event.target.matches("input, textarea"))
      undo();
    if (event.key === "Enter" && (event.ctrlKey || event.metaKey || event.target.matches("#setup input")))
      submit();
  });
  await load();
}

/** Fetches what the service offers. */
async function load() {
  try {
    const [drives, openapi, maps, request] = await Promise.all([
      getJson("/v1/drives"),
      getJson("/openapi.json"),
      getJson("/v1/maps"),
      linked(),
    ]);
    state.drives = new Map(drives.drives.map((drive) => [drive.type, drive]));
    state.schemas = openapi.components.schemas;
    state.maps = maps.maps;
    offerFormats(openapi.paths["/v1/plans"].post.responses[200].content);
    state.request =
      request && state.drives.has(request.robot.drive.type) ? request : structuredClone(EXAMPLE);
  } catch (error) {
    complain(error.problem ?? { title: "The page could not start", detail: String(error) }, error.problem && load);
    return;
  }
  tell("request", "all");
  fit();
  document.documentElement.dataset.ready = "";
}

/** Plans what is set up. One plan at a time: a new one takes the place of the last. */
async function submit() {
  running?.abort();
  const mine = (running = new AbortController());
  const request = structuredClone(state.request);
  state.problem = null;
  tell("problem");
  busy(true, request.options.effort);
  let first = true;
  try {
    await plan(request, mine.signal, (answer, final, elapsed) => {
      if (mine.signal.aborted) return;
      show(new Motion(answer, request), first);
      first = false;
      progress(answer, final, elapsed);
    });
  } catch (error) {
    if (error.name !== "AbortError") {
      if (!error.problem) throw error;
      complain(error.problem, submit);
    }
  } finally {
    if (running === mine) {
      running = null;
      busy(false);
    }
  }
}

/** Puts a plan in view: the first plays from its start, a better one goes on where the last was. */
function show(motion, first) {
  const share = first || !state.motion?.duration ? 0 : player.time / state.motion.duration;
  state.motion = motion;
  state.stale = false;
  player.time = share * motion.duration;
  tell("motion");
  tell("time");
  if (first && !matchMedia("(prefers-reduced-motion: reduce)").matches) play();
  // After the frame: what the observers of sizes draw belongs to it.
  requestAnimationFrame(() => setTimeout(() => performance.mark("plan-first-frame")));
}

function progress(answer, final, elapsed) {
  const spent = elapsed === null ? "" : `after ${fixed(elapsed, 1)} s`;
  if (!final)
    byId("plan").replaceChildren(
      "Improving",
      element("small", {}, `${fixed(answer.duration, 2)} s ${spent}`),
    );
  byId("stop").textContent = "Stop, keep this one";
  byId("stop").hidden = final;
  tell(
    "announce",
    `${final ? "Planned" : "A plan so far"}: ${fixed(answer.duration, 2)} seconds, ${fixed(answer.length, 2)} metres.`,
  );
}

function busy(on, effort) {
  byId("plan").replaceChildren(on ? (effort === "best" ? "Looking for the best" : "Planning") : "Plan");
  byId("plan").classList.toggle("busy", on);
  byId("stop").textContent = "Stop";
  clearTimeout(patience);
  byId("stop").hidden = true;
  if (on) patience = setTimeout(() => (byId("stop").hidden = false), PATIENCE);
}

start();
