// What a campaign's page shows.
const examine = async () => {
  const names = (id) => document.getElementById(id).data.map((trace) => trace.name);
  return {
    pareto: names("pareto"),
    spreads: names("spreads"),
    fallbacks: names("fallbacks"),
    labels: [...document.querySelectorAll("#fallbacks .xtick text")].map((text) => text.textContent),
    rows: document.querySelectorAll("tbody tr").length,
    overflow: document.documentElement.scrollWidth > innerWidth,
  };
};
