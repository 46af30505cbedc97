/** The service's interface, as the page uses it. Every failure is a Refused with a problem document. */

import { askToken, token } from "./access.js";

export class Refused extends Error {
  constructor(problem) {
    super(problem.detail);
    this.problem = problem;
  }
}

export async function getBlob(path) {
  return (await answered(path, {})).blob();
}

export async function getJson(path) {
  return (await answered(path, {})).json();
}

/** Uploads a map_server pair; its summary. */
export async function uploadMap(yaml, image) {
  const form = new FormData();
  form.append("yaml", yaml);
  form.append("image", image);
  return (await answered("/v1/maps", { method: "POST", body: form })).json();
}

/** The plan of a request in another media type, as a Blob. */
export async function planAs(type, request) {
  return (await answered("/v1/plans", post(request, type))).blob();
}

/**
 * Plans. heard(plan, final, elapsed) is called with each plan: once, or with effort "best", from a service that
 * streams, with the first at once and then with every better one.
 */
export async function plan(request, signal, heard) {
  const streams = request.options?.effort === "best";
  const accept = streams ? "text/event-stream, application/json;q=0.5" : "application/json";
  const response = await answered("/v1/plans", post(request, accept, signal));
  if (!response.headers.get("Content-Type").startsWith("text/event-stream")) {
    const text = await response.text();
    performance.mark("plan-response");
    heard(JSON.parse(text), true, null);
    return;
  }
  for await (const { name, data } of events(response.body)) {
    if (name === "problem") throw new Refused(JSON.parse(data));
    if (name !== "plan") continue;
    performance.mark("plan-response");
    const said = JSON.parse(data);
    heard(said.plan, said.final, said.elapsed);
    if (said.final) return;
  }
  throw new Refused({
    code: "",
    title: "The stream ended early",
    detail: "The last plan it brought is kept.",
  });
}

function post(request, accept, signal = undefined) {
  const headers = { "Content-Type": "application/json", Accept: accept };
  return { method: "POST", headers, body: JSON.stringify(request), signal };
}

async function answered(path, init) {
  let response;
  try {
    const allowed = token.get() ? { Authorization: `Bearer ${token.get()}` } : {};
    response = await fetch(path, { ...init, headers: { ...init.headers, ...allowed } });
  } catch (error) {
    if (error.name === "AbortError") throw error;
    throw new Refused({
      code: "unreachable",
      title: "The service does not answer",
      detail: "Is it still running?",
    });
  }
  if (response.ok) return response;
  if (response.status === 401 && (await askToken())) return answered(path, init);
  const problem = await response.json().catch(() => ({}));
  const title = problem.title ?? `The service answered ${response.status}`;
  throw new Refused({ code: "", detail: "", ...problem, title });
}

/** The events of a text/event-stream body. */
async function* events(body) {
  let rest = "";
  for await (const text of chunks(body.pipeThrough(new TextDecoderStream()))) {
    const blocks = (rest + text).replaceAll("\r\n", "\n").split("\n\n");
    rest = blocks.pop();
    for (const block of blocks) {
      const lines = block
        .split("\n")
        .map((line) => /^(\w+): ?(.*)$/.exec(line))
        .filter(Boolean);
      const of = (field) => lines.filter((line) => line[1] === field).map((line) => line[2]);
      if (lines.length === 0) continue; // a comment, which says that the service still plans
      yield { name: of("event").at(-1) ?? "message", data: of("data").join("\n") };
    }
  }
}

/** What a stream brings. Safari has no `for await` over streams. */
async function* chunks(stream) {
  const reader = stream.getReader();
  try {
    for (let next = await reader.read(); !next.done; next = await reader.read()) yield next.value;
  } finally {
    reader.cancel().catch(() => {});
  }
}
