"use strict";

const script = document.createElement("script");
script.textContent = document.getElementById("plotly").textContent;
document.head.append(script);

for (const plot of JSON.parse(document.getElementById("curves-data").textContent)) {
  const traces = Object.entries(plot.lines).map(([name, values]) => ({
    type: "scatter",
    mode: values.length > 1 ? "lines" : "markers",
    name,
    x: values.map((_, epoch) => epoch + 1),
    y: values,
  }));
  const layout = {
    margin: { l: 50, r: 10, t: 32, b: 40 },
    title: { text: plot.title, font: { size: 14 } },
    xaxis: { title: { text: "epoch", font: { size: 12 } } },
    yaxis: { title: { text: plot.unit, font: { size: 12 } } },
    showlegend: true,
    legend: { orientation: "h", y: -0.25, font: { size: 11 } },
    paper_bgcolor: "rgba(0,0,0,0)",
  };
  Plotly.newPlot(`curve-${plot.name}`, traces, layout, {
    displaylogo: false,
    displayModeBar: false,
    responsive: true,
  });
}
