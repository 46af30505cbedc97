/** Taking it elsewhere: the request as a curl command or a link, the plan as a file. */

import { token } from "./access.js";
import { planAs } from "./client.js";
import { byId, element } from "./dom.js";
import { words } from "./format.js";
import { link } from "./link.js";
import { complain } from "./problems.js";
import { on, state, tell } from "./state.js";

/** Made here of the plan in view. Other formats are asked for: the service's own document lists them. */
const OWN = [
  { type: "application/json", title: "JSON", make: ({ answer }) => JSON.stringify(answer) },
  { type: "text/csv", title: "CSV, the schedule as a table", make: ({ answer }) => csv(answer) },
];

export function startExport() {
  byId("copy-curl").addEventListener("click", (event) => copy(byId("curl").textContent, event.target));
  byId("copy-link").addEventListener("click", async (event) =>
    copy(await link(state.motion.request), event.target),
  );
  byId("download").addEventListener("click", download);
  byId("format").addEventListener("change", note);
  on("motion", () => {
    if (state.motion) byId("curl").textContent = curl(state.motion.request);
    note();
  });
}

/** Offers what the service says it answers with. @param content media types of POST /v1/plans */
export function offerFormats(content) {
  const others = Object.entries(content)
    .filter(([type]) => type !== "text/event-stream" && !OWN.some((own) => own.type === type))
    .map(([type, { schema }]) => ({ type, title: schema.description?.replace(/\.$/, "") ?? type }));
  const options = [...OWN, ...others].map(({ type, title }) => element("option", { value: type }, title));
  byId("format").replaceChildren(...options);
}

/** Says so where a file would not hold the very plan in view. */
function note() {
  const own = OWN.some((format) => format.type === byId("format").value);
  const another = !own && state.motion?.request.options?.effort === "best";
  byId("format-note").textContent = another ? "Planned anew: with effort best it may be another plan." : "";
}

/** The command that asks for the plan in view. */
function curl(request) {
  const body = JSON.stringify(request).replaceAll("'", "'\\''");
  const allowed = token.get() ? ` \\\n  -H "Authorization: Bearer $TOKEN"` : "";
  return `curl -s ${location.origin}/v1/plans${allowed} \\\n  -H 'Content-Type: application/json' \\\n  -d '${body}'`;
}

async function download() {
  const [{ value: type, text: title }] = byId("format").selectedOptions;
  const { motion } = state;
  try {
    const make = OWN.find((own) => own.type === type)?.make;
    const content = make ? new Blob([make(motion)], { type }) : await planAs(type, motion.request);
    const url = URL.createObjectURL(content);
    element("a", { href: url, download: `plan-${motion.answer.id.slice(0, 8)}.${extension(type)}` }).click();
    setTimeout(() => URL.revokeObjectURL(url), 1e3);
  } catch (error) {
    byId("export").hidePopover();
    const detail = `The service does not make this for ${words(motion.request.robot.drive.type)}.`;
    complain(error.problem.code === "not-acceptable" ? { ...error.problem, title, detail } : error.problem);
  }
}

/** "application/vnd.wheelplan.wpilib+json" → "wpilib.json", "image/svg+xml" → "svg". */
function extension(type) {
  const [, own] = /^application\/vnd\.\w+\.(.+)\+json$/.exec(type) ?? [];
  return own ? `${own}.json` : type.split("/")[1].split("+")[0];
}

/** The table that `Accept: text/csv` gives. */
function csv({ schedule, trajectory }) {
  const columns = [
    ["time", schedule.time],
    ...["x", "y", "theta"].map((name) => [name, trajectory[name]]),
    ...Object.entries(schedule.wheels).map(([name, wheel]) => [`${name}.velocity`, wheel.velocity]),
    ...Object.entries(schedule.steering).map(([name, wheel]) => [`${name}.steering`, wheel.angle]),
  ];
  const rows = schedule.time.map((_, i) => columns.map(([, values]) => values[i]).join(","));
  return [columns.map(([name]) => name).join(","), ...rows, ""].join("\n");
}

/** Where the page is not served over TLS or from this machine, there is no clipboard interface but this old one. */
async function copy(text, button) {
  if (navigator.clipboard) await navigator.clipboard.writeText(text).catch(() => {});
  else {
    const area = element("textarea", { value: text, className: "unseen" });
    button.after(area);
    area.select();
    document.execCommand("copy");
    area.remove();
  }
  const title = button.textContent;
  button.textContent = "Copied";
  setTimeout(() => (button.textContent = title), 1200);
  tell("announce", "Copied.");
}
