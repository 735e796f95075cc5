// Runs before anything else on the page and remembers what goes wrong.
window.findings = { errors: [], blocked: [] };
console.error = (...words) => findings.errors.push(words.map(String).join(" "));
addEventListener("error", (event) => findings.errors.push(event.message || "a resource failed"), true);
addEventListener("unhandledrejection", (event) => findings.errors.push(String(event.reason)));
addEventListener("securitypolicyviolation", (event) => findings.blocked.push(event.blockedURI));
