/** Asks for a bearer token, where the service wants one. */

import { byId } from "./dom.js";

/** The token lasts as long as this tab. */
export const token = {
  get: () => sessionStorage.getItem("wheelplan-token"),
  set: (value) => sessionStorage.setItem("wheelplan-token", value),
};

let asking = null;

/** Shows the question, once for all that wait for the answer; whether there is one. */
export function askToken() {
  asking ??= new Promise((answered) => {
    const dialog = byId("access");
    let given = false;
    byId("access-note").textContent = token.get() ? "The service does not know this token." : "";
    byId("access-form").onsubmit = (event) => {
      event.preventDefault();
      token.set(byId("token").value.trim());
      given = true;
      dialog.close();
    };
    dialog.onclose = () => {
      asking = null;
      answered(given);
    };
    dialog.showModal();
  });
  return asking;
}
