// A page that shows itself anew when the scene was run again, and says what is wrong with it meanwhile.
"use strict";
(() => {
  const state = document.getElementById("state");
  const fault = document.getElementById("fault");
  const events = new EventSource("events");
  events.onmessage = (event) => {
    const now = JSON.parse(event.data);
    if (String(now.version) !== state.dataset.version) { location.reload(); return; }
    fault.textContent = now.fault;
    state.textContent = now.running ? "running …" : now.fault ? "the last good result is shown below" : "";
  };
  events.onerror = () => { state.textContent = "dynid watch has ended, or cannot be reached"; };
})();
