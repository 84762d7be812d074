// Units that users may write in a field, and the unit in which the page shows lengths. Server and file have SI units and degrees.
import { signal } from "@preact/signals";

export const LENGTHS = ["m", "mm", "in"] as const;
export type Length = (typeof LENGTHS)[number];
const KEPT = "studio.unit"; // kept for one session of the browser; a new session begins with metres, as in the file

const kept = sessionStorage.getItem(KEPT) as Length | null;
export const length = signal<Length>(kept && LENGTHS.includes(kept) ? kept : "m");

export function measureIn(unit: Length): void {
  length.value = unit;
  sessionStorage.setItem(KEPT, unit);
}

/** A factor to SI, and powers of metre, kilogram, second and radian. */
type Unit = [factor: number, m: number, kg: number, s: number, rad: number];

const UNITS: Record<string, Unit> = {
  m: [1, 1, 0, 0, 0], cm: [0.01, 1, 0, 0, 0], mm: [0.001, 1, 0, 0, 0], in: [0.0254, 1, 0, 0, 0], '"': [0.0254, 1, 0, 0, 0],
  kg: [1, 0, 1, 0, 0], g: [0.001, 0, 1, 0, 0],
  s: [1, 0, 0, 1, 0], ms: [0.001, 0, 0, 1, 0], min: [60, 0, 0, 1, 0],
  N: [1, 1, 1, -2, 0], kN: [1000, 1, 1, -2, 0], Nm: [1, 2, 1, -2, 0], Nmm: [0.001, 2, 1, -2, 0],
  rad: [1, 0, 0, 0, 1], deg: [Math.PI / 180, 0, 0, 0, 1], "°": [Math.PI / 180, 0, 0, 0, 1], rev: [2 * Math.PI, 0, 0, 0, 1],
  rpm: [Math.PI / 30, 0, 0, -1, 1],
};

/** Returns the unit that a text such as "N m s/rad" or "kg mm²" names; null if it names none. */
function unitOf(text: string): Unit | null {
  const out: Unit = [1, 0, 0, 0, 0];
  for (const [place, part] of text.split("/").entries()) {
    for (const word of part.trim().split(/[\s·*]+/)) {
      const [, name, power] = /^(.*?)(?:\^?([23])|[²³])?$/.exec(word)!;
      const unit = UNITS[name!];
      if (!unit || !Object.hasOwn(UNITS, name!)) return null;
      const times = (place ? -1 : 1) * Number(power ?? (word.endsWith("²") ? 2 : word.endsWith("³") ? 3 : 1));
      out[0] *= unit[0] ** times;
      for (let i = 1; i < 5; i++) out[i]! += times * unit[i]!;
    }
  }
  return out;
}

/** Whether two units measure the same quantity; with a mass the radian does not count, because N m s/rad is also written N m s. */
const alike = (a: Unit, b: Unit): boolean => a.every((power, i) => i === 0 || power === b[i] || (i === 4 && a[2] !== 0));

const NUMBER = /^([-+−]?(?:\d+[.,]?\d*|[.,]\d+)(?:e[-+]?\d+)?)\s*(.*)$/i;

/** Returns the number that a text gives in a unit, or null; a text without a unit has the shown unit. */
export function read(text: string, unit: string): number | null {
  const [, digits, own] = NUMBER.exec(text.trim()) ?? [];
  if (digits === undefined) return null;
  const number = Number(digits.replace(",", ".").replace("−", "-"));
  if (!Number.isFinite(number)) return null;
  if (!unit) return own ? null : number;
  const [given, wanted] = [unitOf(own || shownUnit(unit)), unitOf(unit)!];
  if (!given || !alike(given, wanted)) return null;
  return given[0] === wanted[0] ? number : Number(((number * given[0]) / wanted[0]).toPrecision(14)); // 25.4 mm are 0.0254 m
}

/** Returns the refusal of a text that gives no number in a unit. */
export function refusal(text: string, unit: string): string {
  const given = text.trim();
  if (unit === "m") return `“${given}” is no length. Write for example 12 mm, 0.5 in or 1.2 m.`;
  if (unit === "°") return `“${given}” is no angle. Write for example 30 deg or 0.5 rad.`;
  return `“${given}” is no number${unit ? ` in ${shownUnit(unit)}` : ". It has no unit"}.`;
}

/** Returns the unit in which a quantity is shown: the chosen one for lengths, speeds and accelerations, else that of the file. */
export const shownUnit = (unit: string): string => (/^m(\/s²?)?$/.test(unit) ? unit.replace("m", length.value) : unit);

/** Converts a value from a unit to the shown unit. */
export function inShown(value: number, unit: string): number {
  const shown = shownUnit(unit);
  return shown === unit ? value : (value * unitOf(unit)![0]) / unitOf(shown)![0];
}

/** Returns a number as text with four significant digits, without zeros at the end. */
export function figure(value: number | null | undefined, digits = 4): string {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  if (value === 0 || Math.abs(value) < 1e-12) return "0";
  const size = Math.abs(value);
  return size >= 1e5 || size < 1e-4 ? value.toExponential(digits - 2) : String(Number(value.toPrecision(digits)));
}

const IN_METRES = /(?<![\w.])(\d+(?:\.\d+)?(?:e[-+]?\d+)?) (m(?:\/s²?)?)(?![\w/²^·'"”])/g;

/** Returns a sentence of the server with its lengths and speeds, which are in metres, converted to the shown unit. */
export const retold = (text: string): string =>
  length.value === "m" ? text : text.replace(IN_METRES, (_, number: string, unit: string) => amount(Number(number), unit));

/** Returns a value as text, in the shown unit and with this unit. */
export const amount = (value: number | null, unit: string, digits = 4): string =>
  `${figure(value === null ? null : inShown(value, unit), digits)}${unit === "°" ? "°" : ` ${shownUnit(unit)}`}`;
