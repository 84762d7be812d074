// The window on the plane: conversion between metres and pixels, zoom, fit, and the steps of the grid.
import { computed, signal } from "@preact/signals";
import type { Scene, XY } from "./protocol";
import { inShown } from "./units";

/** `scale` [pixels per metre]; `origin`: the world's origin [pixels] from the upper left corner of the canvas. */
export const view = signal<{ scale: number; origin: XY }>({ scale: 600, origin: [300, 400] });
export const size = signal<XY>([800, 600]);

export const toScreen = ([x, y]: XY): XY => {
  const { scale, origin } = view.value;
  return [origin[0] + x * scale, origin[1] - y * scale];
};
export const toWorld = ([x, y]: XY): XY => {
  const { scale, origin } = view.value;
  return [(x - origin[0]) / scale, (origin[1] - y) / scale];
};

/** The distances of fine and of strong lines of the grid [m]: 1, 2 or 5 times a power of ten of the shown unit. */
export const steps = computed<{ fine: number; strong: number }>(() => {
  const unit = inShown(1, "m"); // number of shown units in a metre
  const want = (9 / view.value.scale) * unit;
  const power = 10 ** Math.floor(Math.log10(want));
  const factor = [1, 2, 5, 10].find((f) => f * power >= want) ?? 10;
  const fine = (factor * power) / unit;
  return { fine, strong: factor === 2 ? 5 * fine : factor === 5 ? 4 * fine : 10 * fine };
});

export function zoom(factor: number, about: XY = [size.value[0] / 2, size.value[1] / 2]): void {
  const { scale, origin } = view.value;
  const next = Math.min(Math.max(scale * factor, 1), 1e6);
  const f = next / scale;
  view.value = { scale: next, origin: [about[0] + (origin[0] - about[0]) * f, about[1] + (origin[1] - about[1]) * f] };
}

export function pan(dx: number, dy: number): void {
  const { scale, origin } = view.value;
  view.value = { scale, origin: [origin[0] + dx, origin[1] + dy] };
}

const pointsOf = (scene: Scene | null): XY[] => [...(scene?.pins.map((p) => p.at) ?? []), ...(scene?.slides.flatMap((s) => [s.at, s.block_at]) ?? [])];

const RIM = 16; // [pixels] a joint that is nearer to the window's edge counts as outside

/** Whether all points of the scene, and the points `more`, are in the window. */
export const within = (scene: Scene | null, more: XY[] = []): boolean =>
  [...pointsOf(scene), ...more].map(toScreen).every(([x, y]) => x >= RIM && y >= RIM && x <= size.value[0] - RIM && y <= size.value[1] - RIM);

/** Fits all points of the scene, and the points `more`, into the window with a margin. */
export function fit(scene: Scene | null, more: XY[] = []): void {
  const points = [...pointsOf(scene), ...more];
  const [w, h] = size.value;
  if (!points.length) {
    view.value = { scale: Math.min(w, h) / 1.0, origin: [w * 0.3, h * 0.62] };
    return;
  }
  const xs = points.map((p) => p[0]);
  const ys = points.map((p) => p[1]);
  const [x0, x1, y0, y1] = [Math.min(...xs), Math.max(...xs), Math.min(...ys), Math.max(...ys)];
  const margin = Math.min(90, w / 6, h / 6);
  const scale = Math.min((w - 2 * margin) / Math.max(x1 - x0, 1e-9), (h - 2 * margin) / Math.max(y1 - y0, 1e-9), 5e4);
  const use = Number.isFinite(scale) && scale < 4.9e4 ? scale : Math.min(w, h);
  view.value = { scale: use, origin: [w / 2 - ((x0 + x1) / 2) * use, h / 2 + ((y0 + y1) / 2) * use] };
}

/** Returns the crossing of the fine grid that is nearest to a point of the world. */
export const onGrid = ([x, y]: XY): XY => {
  const step = steps.value.fine;
  const round = (v: number) => Number((Math.round(v / step) * step).toFixed(9));
  return [round(x), round(y)];
};
