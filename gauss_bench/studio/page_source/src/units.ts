// Units: what people may write in a field, and the unit in which the page shows lengths. The server and the file have SI and degrees.
import { signal } from "@preact/signals";

export const LENGTHS = ["m", "mm", "in"] as const;
export type Length = (typeof LENGTHS)[number];
const KEPT = "studio.unit"; // for the session: another one begins in metres, as the file has them

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

/** The unit that a text such as "N m s/rad" or "kg mm²" names; null where it names none. */
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

/** Whether both measure the same; with a mass in it a radian is a number, since N m s/rad is also written N m s. */
const alike = (a: Unit, b: Unit): boolean => a.every((power, i) => i === 0 || power === b[i] || (i === 4 && a[2] !== 0));

const NUMBER = /^([-+−]?(?:\d+[.,]?\d*|[.,]\d+)(?:e[-+]?\d+)?)\s*(.*)$/i;

/** The number that a text means in a unit; without a unit of its own it is in the one that is shown. Null where it means none. */
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

/** A sentence for a text that means nothing in a unit. */
export function refusal(text: string, unit: string): string {
  const given = text.trim();
  if (unit === "m") return `“${given}” is no length. Write for example 12 mm, 0.5 in or 1.2 m.`;
  if (unit === "°") return `“${given}” is no angle. Write for example 30 deg or 0.5 rad.`;
  return `“${given}” is no number${unit ? ` in ${shownUnit(unit)}` : ". It has no unit"}.`;
}

/** The unit in which a quantity is shown: lengths, speeds and accelerations follow the choice, all else is as in the file. */
export const shownUnit = (unit: string): string => (/^m(\/s²?)?$/.test(unit) ? unit.replace("m", length.value) : unit);

/** A value in a unit, as a number in the unit that is shown. */
export function inShown(value: number, unit: string): number {
  const shown = shownUnit(unit);
  return shown === unit ? value : (value * unitOf(unit)![0]) / unitOf(shown)![0];
}

/** A number as people write it: four significant digits, no tail of zeros. */
export function figure(value: number | null | undefined, digits = 4): string {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  if (value === 0 || Math.abs(value) < 1e-12) return "0";
  const size = Math.abs(value);
  return size >= 1e5 || size < 1e-4 ? value.toExponential(digits - 2) : String(Number(value.toPrecision(digits)));
}

const IN_METRES = /(?<![\w.])(\d+(?:\.\d+)?(?:e[-+]?\d+)?) (m(?:\/s²?)?)(?![\w/²^·'"”])/g;

/** A sentence of the server, whose lengths and speeds are in metres, in the unit that is shown. */
export const retold = (text: string): string =>
  length.value === "m" ? text : text.replace(IN_METRES, (_, number: string, unit: string) => amount(Number(number), unit));

/** A value with its unit, as it is shown. */
export const amount = (value: number | null, unit: string, digits = 4): string =>
  `${figure(value === null ? null : inShown(value, unit), digits)}${unit === "°" ? "°" : ` ${shownUnit(unit)}`}`;
