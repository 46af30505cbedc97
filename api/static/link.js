/** The request in the address, deflated, so that a setup can be sent to somebody. */

const PREFIX = "#r=";

/** The address of this page with a request in it. */
export async function link(request) {
  const packed = await through(new Blob([JSON.stringify(request)]), new CompressionStream("deflate-raw"));
  const text = btoa(String.fromCharCode(...new Uint8Array(packed)));
  const hash = text.replaceAll("+", "-").replaceAll("/", "_").replace(/=+$/, "");
  return `${location.origin}${location.pathname}${PREFIX}${hash}`;
}

/** The request in the address, or null. */
export async function linked() {
  if (!location.hash.startsWith(PREFIX)) return null;
  try {
    const text = atob(location.hash.slice(PREFIX.length).replaceAll("-", "+").replaceAll("_", "/"));
    const bytes = Uint8Array.from(text, (letter) => letter.charCodeAt(0));
    const request = JSON.parse(
      await new Response(await through(new Blob([bytes]), new DecompressionStream("deflate-raw"))).text(),
    );
    const whole =
      request.robot.drive.type &&
      request.robot.footprint.type &&
      request.robot.limits &&
      request.start &&
      request.goal;
    return whole && request.environment ? { options: {}, ...request } : null;
  } catch {
    return null; // a link that was cut short: the example is shown instead
  }
}

function through(blob, stream) {
  return new Response(blob.stream().pipeThrough(stream)).arrayBuffer();
}
