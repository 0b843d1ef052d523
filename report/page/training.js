for (const { name, title, unit, lines } of read("curves-data")) {
  const traces = Object.entries(lines).map(([line, values]) => ({
    type: "scatter",
    mode: values.length > 1 ? "lines" : "markers",
    name: line,
    x: values.map((_, epoch) => epoch + 1),
    y: values,
  }));
  plot(`curve-${name}`, traces, title, "epoch", unit, {
    showlegend: true,
    legend: { orientation: "h", y: -0.25, font: { size: 11 } },
  });
}
