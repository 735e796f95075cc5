// Runs last and writes what was found where the test reads it.
const pause = (ms) => new Promise((resolve) => setTimeout(resolve, ms));
// Until what is waited for holds, or will not: a busy machine draws late.
const settled = async (holds) => {
  for (let waited_ms = 0; !holds() && waited_ms < 60000; waited_ms += 50) await pause(50);
};
addEventListener("load", async () => {
  try {
    // What goes wrong after loading is to be seen as well.
    await pause(1000);
    Object.assign(findings, await examine());
  } catch (error) {
    findings.errors.push("the examination: " + error);
  }
  findings.requests = performance.getEntriesByType("resource").map((entry) => entry.name);
  const out = document.createElement("pre");
  out.id = "findings";
  out.textContent = JSON.stringify(findings).replace(/[<>&]/g, "?");
  document.body.append(out);
});
