"use strict";

const at = (id) => document.getElementById(id);
const read = (id) => JSON.parse(at(id).textContent);

/** An element with attributes and children; text stays text. */
function make(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.append(...children);
  return element;
}

/** Plotly, read when something is first drawn. */
function plotly() {
  if (!window.Plotly) {
    const script = make("script");
    script.textContent = at("plotly").textContent;
    document.head.append(script);
  }
  return window.Plotly;
}

// No bar of plotly's: it offers to upload what is drawn.
const BARE = { displaylogo: false, displayModeBar: false, plotlyServerURL: "", responsive: true };

/** A plot in the element `id`; `more` is laid over the layout that all plots have. */
function plot(id, traces, title, x, y, more = {}) {
  const layout = {
    margin: { l: 50, r: 10, t: 32, b: 40 },
    title: { text: title, font: { size: 14 } },
    xaxis: { title: { text: x, font: { size: 12 } } },
    yaxis: { title: { text: y, font: { size: 12 } } },
    paper_bgcolor: "rgba(0,0,0,0)",
    ...more,
  };
  plotly().newPlot(id, traces, layout, BARE);
}
