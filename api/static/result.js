/** What came of the request in figures: duration, length, planner, and the certificate as lamps. */

import { byId, element } from "./dom.js";
import { fixed, label, length } from "./format.js";
import { on, state } from "./state.js";

/** A ratio is shown to a tenth of a per cent; what rounds to 100.0 % is at the limit. */
const AT_LIMIT = 1.0005;

export function startResult() {
  on("motion", show);
  on("request", () => byId("dock").classList.toggle("stale", state.stale));
}

function show() {
  const { motion } = state;
  byId("dock").hidden = !motion;
  if (!motion) return;
  byId("dock").classList.toggle("stale", state.stale);
  const { answer, request } = motion;
  byId("result").replaceChildren(
    element(
      "dl",
      { className: "figures" },
      ...figure("Duration", fixed(answer.duration, 2), "s"),
      ...figure("Length", fixed(answer.length, 2), "m"),
      ...figure(
        "Planner",
        answer.planning.planner,
        "",
        `${fixed(1e3 * (answer.planning.timings?.total ?? 0), 0)} ms`,
      ),
    ),
    element("ul", { className: "lamps" }, ...lamps(answer.certificate, request)),
    element("p", { className: "outdated" }, "The setup has changed since: plan again."),
  );
}

function figure(name, value, unit, note = "") {
  const small = element("small", {}, unit || note);
  return [element("div", {}, element("dt", {}, name), element("dd", {}, value, small))];
}

/** A lamp for each thing that was certified. */
function lamps(certificate, request) {
  const ratios = Object.entries(certificate)
    .filter(([name, value]) => name.endsWith("_ratio") && value > 0)
    .map(([name, value]) =>
      lamp(
        label(name.slice(0, -"_ratio".length)),
        [fixed(100 * value, 1), "%"],
        value <= AT_LIMIT,
        "used of what is allowed",
      ),
    );
  const floor = request.options?.min_clearance ?? 0;
  // The service returns no plan whose closure or slip it does not accept; it does not say how much that is.
  return [
    ...ratios,
    lamp(
      "Closure",
      length(certificate.closure_position),
      true,
      "from the goal to where rolling the wheels ends",
    ),
    lamp(
      "Closure heading",
      [fixed(1e3 * certificate.closure_heading, 2), "mrad"],
      true,
      "the same, for the heading",
    ),
    lamp(
      "Slip",
      [fixed(1e3 * certificate.slip, 2), "mm/s"],
      true,
      "how far the wheels disagree on one rigid motion",
    ),
    lamp(
      "Clearance",
      length(certificate.clearance),
      certificate.clearance >= floor - 1e-4,
      "from the footprint to the nearest obstacle",
    ),
  ];
}

function lamp(name, [value, unit], good, about) {
  const item = element(
    "li",
    { className: good ? "good" : "over", title: `${name}: ${about}` },
    element("span", {}, name),
    element("b", {}, value, element("small", {}, unit)),
  );
  item.prepend(element("i", {}));
  item.append(element("span", { className: "unseen" }, good ? "holds" : "over, within tolerance"));
  return item;
}
