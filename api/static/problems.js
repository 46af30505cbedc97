/** Problem documents, each shown where it belongs: at the field, at the pose, on the floor, or as a notice. */

import { byId, element, icon } from "./dom.js";
import { length } from "./format.js";
import { corners, outline, placed, separation } from "./geometry.js";
import { standing } from "./floor.js";
import { reveal } from "./panel.js";
import { on, parts, state, tell } from "./state.js";

let countdown = 0;

export function startProblems() {
  on("problem", () => {
    if (!state.problem) clear();
  });
}

/** Shows a problem. `retry`, if given, is offered once the service says it may be tried again. */
export function complain(problem, retry = null) {
  clear();
  state.problem = problem;
  const which = /^(start|goal)-in-collision$/.exec(problem.code)?.[1];
  if (which) problem.hit = nearest(which);
  const unplaced = (problem.errors ?? []).filter((error) => !mark(error));
  const fields = document.querySelectorAll(".field.wrong, fieldset.wrong, .chips.wrong");
  if (fields.length && !unplaced.length) {
    reveal(fields[0]);
    fields[0].scrollIntoView({ block: "nearest" });
    const { errors } = problem;
    if (errors.length > 1)
      notice(`${errors.length} fields need another value`, "They are marked in the setup.");
    else notice("A field needs another value", errors[0].detail);
    // Nobody is sent back who already types elsewhere.
    const first = fields[0].querySelector("input, select, textarea");
    if (!byId("setup").contains(document.activeElement)) first?.focus({ preventScroll: true });
  } else {
    notice(
      problem.title,
      [detail(problem, which), ...unplaced.map((error) => error.detail)].filter(Boolean).join(" "),
    );
  }
  if (problem.retry_after && retry) offer(problem.retry_after, retry);
  tell("problem");
  tell("announce", `${problem.title}. ${problem.detail}`);
}

function detail(problem, which) {
  if (which) {
    const against = problem.hit === null ? "" : `, nearest to obstacle ${problem.hit + 1}`;
    const needed = state.request.options.min_clearance ? " of the clearance asked for" : "";
    const [figure, unit] = length(Math.abs(problem.clearance ?? 0));
    return `The footprint is ${figure} ${unit} short${needed || " of being free"}${against}.`;
  }
  if (problem.proof) {
    const { radius, width, width_needed } = problem.proof;
    const [r, ru] = length(radius),
      [w, wu] = length(width),
      [n, nu] = length(width_needed);
    const way =
      width > 0 ? `the widest way, marked on the plan, has ${w} ${wu}` : "what stands between leaves no gap";
    return `Even a disc of radius ${r} ${ru} inside the footprint cannot pass: it needs ${n} ${nu}, and ${way}.`;
  }
  return problem.errors ? "" : problem.detail;
}

/** Index of the drawn obstacle that a pose's footprint overlaps most, or is nearest to; null where there is none. */
function nearest(which) {
  const pose = state.request[which];
  const footprint = placed(outline(state.request.robot.footprint), standing(pose));
  const distances = (state.request.environment.obstacles ?? []).map((o) => separation(footprint, corners(o)));
  const least = Math.min(...distances);
  return least < Infinity ? distances.indexOf(least) : null;
}

/** Puts an error next to the field of its pointer, or of the nearest one above it. */
function mark({ pointer, detail: text }) {
  const way = parts(pointer ?? "").map((part) => part.replaceAll("~", "~0").replaceAll("/", "~1"));
  if (
    way[0] === "environment" &&
    way[1] === "obstacles" &&
    way.length > 2 &&
    state.selected !== Number(way[2])
  ) {
    state.selected = Number(way[2]);
    tell("request", "obstacles");
  }
  for (let n = way.length; n > 1; n--) {
    const at = byId("setup").querySelector(`[data-pointer="${CSS.escape("/" + way.slice(0, n).join("/"))}"]`);
    if (!at) continue;
    at.classList.add("wrong");
    const input = at.querySelector("input, select, textarea");
    const said = element(
      "p",
      { className: "error", id: `error-${document.querySelectorAll(".error").length}` },
      text,
    );
    input?.setAttribute("aria-invalid", "true");
    input?.setAttribute("aria-errormessage", said.id);
    if (at.matches("button")) at.parentElement.after(said);
    else at.append(said);
    reveal(at);
    return true;
  }
  return false;
}

function notice(title, text) {
  const close = element("button", { type: "button", className: "icon quiet" }, icon("close"));
  close.setAttribute("aria-label", "Dismiss");
  close.addEventListener("click", () => {
    state.problem = null;
    tell("problem");
  });
  byId("notice").replaceChildren(
    element("div", {}, element("strong", {}, title), element("p", {}, text)),
    close,
  );
  byId("notice").hidden = false;
}

function offer(seconds, retry) {
  const button = element("button", { type: "button" });
  const until = performance.now() + 1e3 * seconds;
  const count = () => {
    const left = Math.ceil((until - performance.now()) / 1e3);
    button.disabled = left > 0;
    button.textContent = left > 0 ? `Try again in ${left} s` : "Try again";
    if (left <= 0) clearInterval(countdown);
  };
  button.addEventListener("click", retry);
  byId("notice").firstChild.append(button);
  countdown = setInterval(count, 250);
  count();
}

function clear() {
  clearInterval(countdown);
  byId("notice").hidden = true;
  for (const said of document.querySelectorAll("#setup .error")) said.remove();
  for (const at of document.querySelectorAll("#setup .wrong")) at.classList.remove("wrong");
  for (const input of document.querySelectorAll("#setup [aria-invalid]")) {
    input.removeAttribute("aria-invalid");
    input.removeAttribute("aria-errormessage");
  }
}
