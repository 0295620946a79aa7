// The map of the dashboard: the area as cells, and on it goals, routes, tracks, vehicles and what they hear.
// Python sends the constant area once, then changes (swarmctl/dashboard/changes.py), and P_s as bytes.
// The modules in risk_map/ are groups of this component's methods, one idea each.

import cells from "risk-map/cells.js";
import groups from "risk-map/groups.js";
import marks from "risk-map/marks.js";
import names from "risk-map/names.js";
import tiles from "risk-map/tiles.js";
import view from "risk-map/view.js";

const UNHEARD_AFTER_S = 3; // a page gets changes ten times a second

function decoded(base64) {
  const text = atob(base64), bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  return bytes;
}

export default {
  template: `<div class="risk-map">
    <canvas ref="canvas" tabindex="0" aria-label="Map of the area"></canvas>
    <div v-if="unheard_s" class="unheard" role="alert">
      No data from the dashboard for {{ unheard_s }} s: what is shown is that old.
      A restarted dashboard needs its new address.
    </div>
  </div>`,
  data: () => ({ unheard_s: 0 }),
  mounted() {
    this.vehicles = {};
    this.strikes = [];
    this.hearing = [];
    this.conflicts = [];
    this.groups = [];
    this.whose = "";
    this.belief = null;
    this.options = { shading: "heat", hearing: true, hostiles: false, dark: false };
    this.view = { scale: 1, east: 0, north: 0 };
    this.observer = new ResizeObserver(() => this.fit());
    this.observer.observe(this.$el);
    const canvas = this.$refs.canvas;
    canvas.addEventListener("wheel", (event) => this.zoomed(event), { passive: false });
    canvas.addEventListener("pointerdown", (event) => this.pressed(event));
    canvas.addEventListener("pointermove", (event) => this.moved(event));
    canvas.addEventListener("pointerup", (event) => this.released(event));
    canvas.addEventListener("keydown", (event) => this.keyed(event));
    this.pointers = new Map();
    this.ageing = setInterval(() => {
      const unheard_s = Math.floor((Date.now() - (this.heard_ms ?? Infinity)) / 1000);
      this.unheard_s = unheard_s >= UNHEARD_AFTER_S ? unheard_s : 0;
      document.body.classList.toggle("is-old", this.unheard_s > 0);
    }, 500);
    this.$emit("ready");
  },
  unmounted() {
    clearInterval(this.ageing);
    this.observer.disconnect();
  },
  methods: {
    ...view,
    ...tiles,
    ...cells,
    ...marks,
    ...names,
    ...groups,
    set_area(area) {
      this.area = area;
      this.vehicles = {};
      this.belief = null;
      this.exposure = null;
      this.strikes = [];
      for (const [i, name] of area.names.entries()) {
        this.vehicles[name] = { name, colour: area.colours[i], track: [] };
      }
      this.fit();
    },
    set_options(options) {
      Object.assign(this.options, options);
      this.paint_cells();
      this.draw_soon();
    },
    set_exposure(codes, largest) {
      this.exposure = codes === null ? null : decoded(codes);
      this.largest = largest;
      this.paint_cells();
      this.draw_soon();
    },
    set_ghosts(ghosts) {
      this.ghosts = ghosts;
      this.draw_soon();
    },
    apply(changes) {
      if (!this.area) return;
      if (!this.options.places) this.heard_ms = Date.now(); // the set-up sends changes only after a click
      for (const [name, changed] of Object.entries(changes.vehicles ?? {})) {
        const vehicle = this.vehicles[name];
        const { track, ...fields } = changed;
        Object.assign(vehicle, fields);
        if (track) vehicle.track.splice(track.from, Infinity, ...track.points);
      }
      this.whose = changes.whose ?? this.whose;
      if (changes.belief) {
        this.belief = this.merged(this.belief, changes.belief);
        this.paint_cells();
      }
      for (const name of ["hearing", "conflicts", "groups"]) if (name in changes) this[name] = changes[name];
      if (changes.strikes) this.strikes.splice(changes.strikes.from, Infinity, ...changes.strikes.items);
      this.draw_soon();
    },
    merged(before, belief) {
      if (belief.codes) return decoded(belief.codes);
      const codes = before ?? new Uint8Array(this.area.rows * this.area.cols);
      for (let i = 0; i < belief.cells.length; i += 2) codes[belief.cells[i]] = belief.cells[i + 1];
      return codes;
    },
    draw_soon() {
      this.frame ??= requestAnimationFrame(() => {
        this.frame = undefined;
        this.draw();
      });
    },
    draw() {
      const canvas = this.$refs.canvas, context = canvas?.getContext("2d");
      if (!context || !this.area) return;
      const ratio = window.devicePixelRatio || 1;
      context.setTransform(ratio, 0, 0, ratio, 0, 0);
      context.clearRect(0, 0, canvas.width, canvas.height);
      this.ink = this.options.dark ? "#e6e6e6" : "#202020";
      if (this.options.tiles) this.draw_tiles(context, this.options.tiles);
      context.globalAlpha = this.options.tiles ? 0.65 : 1;
      this.draw_cells(context);
      context.globalAlpha = 1;
      this.draw_places(context);
      if (this.options.hearing) this.draw_hearing(context);
      for (const vehicle of Object.values(this.vehicles)) this.draw_routes(context, vehicle);
      for (const ghost of this.ghosts ?? []) this.line(context, ghost.points, ghost.colour, 3, [2, 5]);
      this.draw_groups(context);
      this.draw_strikes(context);
      for (const vehicle of Object.values(this.vehicles)) {
        this.draw_footprint(context, vehicle);
        this.draw_vehicle(context, vehicle);
      }
      this.draw_names(context);
      if (this.exposure) this.draw_scale(context);
      if (this.options.places && this.cursor) this.draw_cursor(context);
    },
  },
};
