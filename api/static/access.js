/** Asks for a bearer token, where the service wants one. */

import { token } from "./client.js";
import { byId } from "./dom.js";

/** Shows the question; `again` is what to do with the answer. */
export function askToken(again) {
  const dialog = byId("access");
  byId("access-note").textContent = token.get() ? "The service does not know this token." : "";
  byId("access-form").onsubmit = (event) => {
    event.preventDefault();
    token.set(byId("token").value.trim());
    dialog.close();
    again();
  };
  dialog.showModal();
}
