// Types of the messages between server and page. Lengths are in metres, poses in radians; numbers that are not finite are null.

export type XY = [number, number];
export type Pose = [number, number, number];
export type Poses = Record<string, Pose>;
export type Table = Record<string, unknown>;

export interface Link {
  name: string;
  pose: Pose;
  points: Record<string, XY>;
  bars: [string, string][];
  mass: number | null;
  inertia: number | null;
  kg_per_m: number | null;
  placed: boolean;
  locked: { angle: boolean; lengths: [string, string][] };
}
export interface Pin {
  id: string;
  at: XY;
  members: string[];
  joint: string | null;
  ground: boolean;
  locked: boolean;
  stiff: boolean; // its links keep their relative angle in a drag
}
export interface Slide {
  id: string;
  guide: string;
  at: XY;
  angle: number;
  block: string;
  block_at: XY;
  offset: number;
  locked: boolean;
}
export interface Force {
  id: string;
  type: string;
  table: Table;
  at: XY[];
  label: string;
}
export interface Problem {
  level: "error" | "warning" | "hint";
  text: string;
  where: string[];
  loop: string[] | null;
  apart: number | null;
}
export interface Driver {
  name: string;
  kind: "angle" | "slide" | "length";
}
export interface Scenario {
  name: string;
  kind: "driven" | "free";
  table: Table;
}
export interface Picture {
  id: string; // the picture itself is requested once
  at: XY;
  width: number;
  height: number;
}
export interface Scene {
  revision: number;
  name: string;
  title: string;
  path: string | null;
  unsaved: boolean;
  can_undo: boolean;
  can_redo: boolean;
  gravity: XY;
  crank: string | null;
  ground: { points: Record<string, XY> };
  links: Link[];
  pins: Pin[];
  slides: Slide[];
  forces: Force[];
  observe: string[];
  scenarios: Scenario[];
  drivers_possible: Driver[];
  status: { assembles: boolean; dof: number | null; loops: number; redundant: number | null; loop_names: string[][] };
  problems: Problem[];
  picture: Picture | null;
}
export interface Series {
  name: string;
  values: (number | null)[];
}
export interface Motion {
  job?: number; // an event with this number brings the singular positions later
  times: number[];
  poses: Record<string, Pose[]>;
  points: Record<string, { p: XY[]; v: XY[] | null; a: XY[] | null }>;
  input: (Series & { unit?: string }) | null;
  singular: { kind: string; coordinate: string; value: number | null; input: number | null; poses: Poses | null }[];
  transmission: Series[];
  torque: { unit: string; values: (number | null)[] } | null;
  pins: { joint: string; force: ([number | null, number | null] | null)[] }[];
  advantage: { input: string; output: string; values: (number | null)[] }[] | null;
  limits: string | null;
  note: string | null;
}
export interface Centre {
  links: [string, string];
  at: XY | null;
}
export interface Template {
  name: string;
  title: string;
  kind: string;
  drawing?: string;
}
export interface Hello {
  version: string;
  templates: Template[];
  linkages: string[];
  files?: string[];
  folder?: string;
  engines: { name: string; here: boolean; reason: string | null }[];
  recovered: { text: string } | null;
  kept?: string[]; // files of the folder with unsaved changes that have been kept
  scene: Scene;
}
export interface Fault {
  text: string;
  where?: string[];
  field?: string;
}
export type Reply = { id: number; ok: true; scene?: Scene } & Record<string, unknown>;
export interface Event {
  event: string;
  job?: number;
  [key: string]: unknown;
}
