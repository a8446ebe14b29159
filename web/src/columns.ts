// Curves with stamps of their own as the one table that uPlot draws.
import uPlot from "uplot";
import type {SeriesData} from "./types";

/** Columns for uPlot: of each series y, and where it has a band, its upper and lower edge behind it. */
export interface Columns {
  data: uPlot.AlignedData;
  /** For each series: its column, and those of its band. */
  places: {y: number; band: [number, number] | null}[];
}

export function columnsOf(series: SeriesData[]): Columns {
  const tables: uPlot.AlignedData[] = [], places: Columns["places"] = [];
  let next = 1;
  for (const {t, y, band, style} of series) {
    const table: (number | null)[][] = [t, y];
    if (band) {
      const centre = (i: number): number | null => style === "error" ? 0 : y[i] ?? null;
      const edge = (sign: number): (number | null)[] => band.map((half, i) => {
        const c = centre(i);
        return half === null || c === null ? null : c + sign * half;
      });
      table.push(edge(1), edge(-1));
    }
    tables.push(table as uPlot.AlignedData);
    places.push({y: next, band: band ? [next + 1, next + 2] : null});
    next += band ? 3 : 1;
  }
  return {data: tables.length ? uPlot.join(tables) : [[]], places};
}
