// Where the data come from decides what the page is.
import {showRuns} from "./compare";
import {el, embedded} from "./dom";
import {fromBase64} from "./event_store";
import {showLive} from "./live";
import {showReport} from "./report";
import {themeSwitch} from "./theme";
import type {PageSource, RunData} from "./types";

async function start(): Promise<void> {
  const host = document.getElementById("page")!;
  document.body.prepend(themeSwitch());
  try {
    const source = JSON.parse(embedded("page-source")) as PageSource;
    if (source.kind === "live") showLive(host, source.name);
    else if (source.kind === "runs") await showRuns(host, source.runs);
    else showReport(host, JSON.parse(embedded("run-data")) as RunData, fromBase64(embedded("run-events")));
    document.body.dataset["ready"] = "yes";
  } catch (error) {
    host.append(el("p", {class: "banner bad"}, el("strong", {}, "This page cannot be shown: "), String(error)));
    throw error;
  }
}

void start();
