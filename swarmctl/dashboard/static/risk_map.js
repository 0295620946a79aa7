// The map of the dashboard: the area as cells, and on it goals, routes, tracks, vehicles and what they hear.
// Python sends the constant area once, then changes (swarmctl/dashboard/changes.py), and P_s as bytes.

const SEEN = 1, OCCUPIED = 2, OWN = 4;
const MARGIN_PX = 28;
const EARTH_ROUND_M = 40075016.7, MAX_TILES = 64;
const UNHEARD_AFTER_S = 3; // a page gets changes ten times a second

function decoded(base64) {
  const text = atob(base64), bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  return bytes;
}

function mixed(a, b, share) {
  return a.map((value, i) => Math.round(value + (b[i] - value) * share));
}

// Light to dark in one hue family: legible in grey print and for colour-blind readers.
const STOPS = {
  light: [[255, 255, 255], [253, 212, 158], [252, 141, 89], [179, 0, 0], [80, 0, 0]],
  dark: [[24, 28, 34], [74, 48, 36], [170, 80, 30], [240, 160, 60], [255, 235, 180]],
};

function shade(share, isDark) {
  const stops = isDark ? STOPS.dark : STOPS.light;
  const at = Math.min(Math.max(share, 0), 1) * (stops.length - 1), i = Math.min(Math.floor(at), stops.length - 2);
  return mixed(stops[i], stops[i + 1], at - i);
}

export default {
  template: `<div class="risk-map">
    <canvas ref="canvas" tabindex="0" aria-label="Map of the area"></canvas>
    <div v-if="unheard_s" class="unheard" role="alert">
      No data from the dashboard for {{ unheard_s }} s: the page is old
    </div>
  </div>`,
  data: () => ({ unheard_s: 0 }),
  mounted() {
    this.vehicles = {};
    this.growing = { events: [], changes: [], strikes: [] };
    this.hearing = [];
    this.conflicts = [];
    this.belief = null;
    this.options = { shading: "heat", whose: "", hearing: true, hostiles: false, old_routes: true, dark: false };
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
    }, 500);
    this.$emit("ready");
  },
  unmounted() {
    clearInterval(this.ageing);
    this.observer.disconnect();
  },
  methods: {
    set_area(area) {
      this.area = area;
      this.vehicles = {};
      this.belief = null;
      this.exposure = null;
      this.growing = { events: [], changes: [], strikes: [] };
      for (const [i, name] of area.names.entries()) {
        this.vehicles[name] = { name, colour: area.colours[i], track: [], belief: null };
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
      this.time_s = changes.time_s;
      if ("unix_s" in changes) this.heard_ms = Date.now();
      for (const [name, changed] of Object.entries(changes.vehicles ?? {})) {
        const vehicle = this.vehicles[name];
        const { track, belief, ...fields } = changed;
        Object.assign(vehicle, fields);
        if (track) vehicle.track.splice(track.from, Infinity, ...track.points);
        if (belief) vehicle.belief = this.merged(vehicle.belief, belief);
      }
      if (changes.belief) this.belief = this.merged(this.belief, changes.belief);
      for (const name of ["hearing", "conflicts"]) if (name in changes) this[name] = changes[name];
      for (const [name, items] of Object.entries(this.growing)) {
        if (name in changes) items.splice(changes[name].from, Infinity, ...changes[name].items);
      }
      if (changes.belief || Object.values(changes.vehicles ?? {}).some((v) => v.belief)) this.paint_cells();
      this.draw_soon();
    },
    merged(before, belief) {
      if (belief.codes) return decoded(belief.codes);
      const codes = before ?? new Uint8Array(this.area.rows * this.area.cols);
      for (let i = 0; i < belief.cells.length; i += 2) codes[belief.cells[i]] = belief.cells[i + 1];
      return codes;
    },
    shown_belief() {
      return this.options.whose ? this.vehicles[this.options.whose]?.belief : this.belief;
    },
    // The cells are painted once a change, one pixel a cell, and drawn enlarged with each frame.
    paint_cells() {
      if (!this.area) return;
      const { rows, cols } = this.area, dark = this.options.dark, codes = this.shown_belief();
      const cells = (this.cells ??= document.createElement("canvas"));
      cells.width = cols;
      cells.height = rows;
      const context = cells.getContext("2d"), image = context.createImageData(cols, rows);
      for (let row = 0; row < rows; row++) {
        for (let col = 0; col < cols; col++) {
          const i = row * cols + col, code = codes?.[i] ?? 0, at = 4 * ((rows - 1 - row) * cols + col);
          const share = this.exposure ? this.exposure[i] / 255 : 0;
          let colour = shade(this.options.shading === "heat" ? share : 0, dark);
          if (this.options.shading === "paper") {
            const grey = Math.round(255 * (1 - share));
            colour = [grey, grey, grey];
          }
          if (code & OCCUPIED) colour = dark ? [255, 80, 80] : [40, 0, 0];
          image.data.set([...colour, 255], at);
        }
      }
      context.putImageData(image, 0, 0);
    },
    fit() {
      const canvas = this.$refs.canvas, box = this.$el.getBoundingClientRect();
      const ratio = window.devicePixelRatio || 1;
      canvas.width = Math.max(1, Math.round(box.width * ratio));
      canvas.height = Math.max(1, Math.round(box.height * ratio));
      canvas.style.width = `${box.width}px`;
      canvas.style.height = `${box.height}px`;
      if (this.area && !this.has_moved) {
        const { rows, cols, cell_size_m } = this.area;
        const margin = this.options.margin_px ?? MARGIN_PX;
        const width = Math.max(box.width - 2 * margin, 1), height = Math.max(box.height - 2 * margin, 1);
        this.view.scale = Math.min(width / (cols * cell_size_m), height / (rows * cell_size_m));
        this.view.east = (cols * cell_size_m) / 2;
        this.view.north = (rows * cell_size_m) / 2;
      }
      this.paint_cells();
      this.draw_soon();
    },
    place([east, north]) {
      const box = this.$refs.canvas, ratio = window.devicePixelRatio || 1, { scale } = this.view;
      return [
        box.width / ratio / 2 + (east - this.view.east) * scale,
        box.height / ratio / 2 - (north - this.view.north) * scale,
      ];
    },
    centre([row, col]) {
      const size = this.area.cell_size_m;
      return [(col + 0.5) * size, (row + 0.5) * size];
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
      this.draw_strikes(context);
      for (const [i, vehicle] of Object.values(this.vehicles).entries()) {
        this.draw_footprint(context, vehicle, this.area.footprints_m[i]);
        this.draw_vehicle(context, vehicle);
      }
      if (this.exposure) this.draw_scale(context);
      if (this.options.places && this.cursor) this.draw_cursor(context);
    },
    // Tiles in Web Mercator below the cells. The corners of the area give the place of a longitude and latitude;
    // over a few kilometres both are linear.
    draw_tiles(context, tiles) {
      const { corners, rows, cols, cell_size_m } = this.area, [[lat, lon], [, lon_east], [lat_north]] = corners;
      const lon_per_m = (lon_east - lon) / (cols * cell_size_m), lat_per_m = (lat_north - lat) / (rows * cell_size_m);
      const across_m = EARTH_ROUND_M * Math.cos((lat * Math.PI) / 180);
      const fitting = Math.round(Math.log2((across_m * this.view.scale) / 256));
      const zoom = Math.min(Math.max(fitting, tiles.min_zoom), tiles.max_zoom), n = 2 ** zoom;
      const column = (east) => ((lon + east * lon_per_m + 180) / 360) * n;
      const row = (north) => {
        const angle = ((lat + north * lat_per_m) * Math.PI) / 180;
        return ((1 - Math.asinh(Math.tan(angle)) / Math.PI) / 2) * n;
      };
      const east = (x) => ((x / n) * 360 - 180 - lon) / lon_per_m;
      const north = (y) => ((Math.atan(Math.sinh(Math.PI * (1 - (2 * y) / n))) * 180) / Math.PI - lat) / lat_per_m;
      const { clientWidth, clientHeight } = context.canvas;
      const [west_m, north_m] = this.where([0, 0]), [east_m, south_m] = this.where([clientWidth, clientHeight]);
      const left = Math.floor(column(west_m)), right = Math.floor(column(east_m));
      const top = Math.floor(row(north_m)), bottom = Math.floor(row(south_m));
      if ((right - left + 1) * (bottom - top + 1) > MAX_TILES) return;
      for (let x = left; x <= right; x++) {
        for (let y = top; y <= bottom; y++) {
          const image = this.tile(tiles.template.replace("{z}", zoom).replace("{x}", x).replace("{y}", y));
          if (!image.naturalWidth) continue;
          const [x0, y0] = this.place([east(x), north(y)]), [x1, y1] = this.place([east(x + 1), north(y + 1)]);
          context.drawImage(image, x0, y0, x1 - x0, y1 - y0);
        }
      }
      context.font = "11px system-ui, sans-serif";
      context.fillStyle = this.ink;
      context.fillText(tiles.attribution, 6, clientHeight - 6);
    },
    tile(address) {
      this.images ??= new Map();
      let image = this.images.get(address);
      if (!image) {
        image = new Image();
        image.onload = () => this.draw_soon();
        image.src = address;
        this.images.set(address, image);
        if (this.images.size > 4 * MAX_TILES) this.images.delete(this.images.keys().next().value);
      }
      return image;
    },
    draw_cells(context) {
      const { rows, cols, cell_size_m } = this.area, cell = cell_size_m * this.view.scale;
      const [left, top] = this.place([0, rows * cell_size_m]);
      context.imageSmoothingEnabled = false;
      if (this.cells) context.drawImage(this.cells, left, top, cols * cell, rows * cell);
      const codes = this.shown_belief();
      if (cell >= 4) {
        context.beginPath();
        for (let row = 0; row < rows; row++) {
          for (let col = 0; col < cols; col++) {
            if ((codes?.[row * cols + col] ?? 0) & SEEN) continue;
            const x = left + col * cell, y = top + (rows - 1 - row) * cell;
            context.moveTo(x, y + cell);
            context.lineTo(x + cell, y);
          }
        }
        context.strokeStyle = this.options.dark ? "rgba(255,255,255,0.16)" : "rgba(0,0,0,0.16)";
        context.lineWidth = 1;
        context.stroke();
      }
      if (this.options.whose && cell >= 8) this.draw_own(context, codes, left, top, cell);
      context.strokeStyle = this.ink;
      context.lineWidth = 1;
      context.strokeRect(left, top, cols * cell, rows * cell);
    },
    // Cells that the chosen vehicle has seen itself carry a dot of its colour; heard cells carry none.
    draw_own(context, codes, left, top, cell) {
      const { rows, cols } = this.area;
      context.fillStyle = this.vehicles[this.options.whose].colour;
      for (let i = 0; i < (codes?.length ?? 0); i++) {
        if (!(codes[i] & OWN)) continue;
        const x = left + ((i % cols) + 0.5) * cell, y = top + (rows - 0.5 - Math.floor(i / cols)) * cell;
        context.fillRect(x - 1.5, y - 1.5, 3, 3);
      }
    },
    draw_places(context) {
      const cell = this.area.cell_size_m * this.view.scale;
      for (const place of this.area.no_fly) {
        const [x, y] = this.place(this.centre(place));
        context.fillStyle = "rgba(86, 86, 110, 0.55)";
        context.fillRect(x - cell / 2, y - cell / 2, cell, cell);
      }
      for (const goal of this.area.goals) {
        const [x, y] = this.place(this.centre(goal)), r = Math.max(cell / 2, 6);
        context.strokeStyle = "#009e73";
        context.lineWidth = 2;
        context.strokeRect(x - r, y - r, 2 * r, 2 * r);
        context.strokeRect(x - r / 2, y - r / 2, r, r);
      }
      if (this.options.hostiles) {
        for (const hostile of this.area.hostiles ?? []) {
          const [x, y] = this.place(this.centre(hostile)), r = Math.max(cell / 3, 4);
          context.beginPath();
          context.moveTo(x - r, y - r);
          context.lineTo(x + r, y + r);
          context.moveTo(x + r, y - r);
          context.lineTo(x - r, y + r);
          this.stroke_edged(context, "#cc0000", 2);
        }
      }
      if (this.area.fence.length) this.line(context, [...this.area.fence, this.area.fence[0]], this.ink, 1, [8, 4]);
    },
    // A light edge keeps red legible on dark cells, for colour-blind readers too.
    stroke_edged(context, colour, width) {
      context.strokeStyle = "#fff";
      context.lineWidth = width + 2;
      context.stroke();
      context.strokeStyle = colour;
      context.lineWidth = width;
      context.stroke();
    },
    draw_hearing(context) {
      for (const edge of this.hearing) {
        const from = this.vehicles[edge.sender]?.position, to = this.vehicles[edge.receiver]?.position;
        if (!from || !to) continue;
        const strength = Math.max(0.08, 0.5 - edge.age_s / 20) * (1 - (edge.loss ?? 0));
        context.globalAlpha = strength;
        this.line(context, [from, to], this.ink, 1, [3, 3]);
        context.globalAlpha = 1;
      }
      for (const conflict of this.conflicts) {
        const [x, y] = this.place(conflict.at);
        context.strokeStyle = "#cc0000";
        context.lineWidth = 2;
        context.beginPath();
        context.arc(x, y, 12, 0, 2 * Math.PI);
        context.stroke();
      }
    },
    line(context, points, colour, width, dash = []) {
      if (points.length < 2) return;
      context.beginPath();
      points.forEach((point, i) => (i ? context.lineTo : context.moveTo).call(context, ...this.place(point)));
      context.strokeStyle = colour;
      context.lineWidth = width;
      context.setLineDash(dash);
      context.stroke();
      context.setLineDash([]);
    },
    draw_routes(context, vehicle) {
      const change = this.options.change;
      if (change && change.vehicle === vehicle.name && change.old) {
        this.line(context, (change.old_now ?? change.old).points, vehicle.colour, 2, [2, 4]);
      }
      this.line(context, vehicle.track, vehicle.colour, 2.5);
      if (vehicle.route) this.line(context, vehicle.route.points, vehicle.colour, 1.5, [7, 5]);
    },
    draw_strikes(context) {
      for (const strike of this.growing.strikes) {
        const [x, y] = this.place(strike.at);
        context.fillStyle = "#cc0000";
        context.beginPath();
        for (let i = 0; i < 10; i++) {
          const angle = (Math.PI * i) / 5, r = i % 2 ? 3 : 8;
          context.lineTo(x + r * Math.sin(angle), y - r * Math.cos(angle));
        }
        context.closePath();
        context.strokeStyle = "#fff";
        context.lineWidth = 2;
        context.stroke();
        context.fill();
      }
    },
    // The sensor sees the cells whose centres lie in this square around the vehicle.
    draw_footprint(context, vehicle, footprint_m) {
      if (!vehicle.position || !footprint_m || vehicle.is_silent || !(vehicle.height_m > 1)) return;
      const [x, y] = this.place(vehicle.position), half = footprint_m * this.view.scale;
      context.strokeStyle = vehicle.colour;
      context.lineWidth = 1;
      context.setLineDash([2, 3]);
      context.strokeRect(x - half, y - half, 2 * half, 2 * half);
      context.setLineDash([]);
    },
    // P_s from 0 to the darkest shade, at the lower left of the map.
    draw_scale(context) {
      const { dark, shading } = this.options, { clientHeight } = context.canvas, wide = 90, high = 10;
      const top = clientHeight - 16 - (this.options.tiles ? 14 : 0), left = 8;
      context.fillStyle = dark ? "rgba(16, 20, 24, 0.8)" : "rgba(255, 255, 255, 0.85)";
      context.fillRect(left - 4, top - 5, wide + 88, high + 10);
      for (let x = 0; x < wide; x++) {
        const share = x / wide, grey = Math.round(255 * (1 - share));
        context.fillStyle = `rgb(${shading === "paper" ? [grey, grey, grey] : shade(share, dark)})`;
        context.fillRect(left + x, top, 1, high);
      }
      context.lineWidth = 1;
      context.strokeStyle = context.fillStyle = this.ink;
      context.strokeRect(left, top, wide, high);
      context.font = "11px system-ui, sans-serif";
      context.fillText(`P_s 0 to ${this.largest.toFixed(2)}`, left + wide + 8, top + high - 1);
    },
    draw_vehicle(context, vehicle) {
      if (!vehicle.position) return;
      const [x, y] = this.place(vehicle.position), angle = ((vehicle.heading_deg ?? 0) * Math.PI) / 180;
      context.globalAlpha = vehicle.is_silent ? 0.45 : 1;
      context.save();
      context.translate(x, y);
      context.rotate(angle);
      context.beginPath();
      context.moveTo(0, -11);
      context.lineTo(7, 8);
      context.lineTo(0, 4);
      context.lineTo(-7, 8);
      context.closePath();
      context.fillStyle = vehicle.colour;
      context.fill();
      context.strokeStyle = this.options.dark ? "#000" : "#fff";
      context.lineWidth = 1.5;
      context.stroke();
      context.restore();
      const unheard = vehicle.is_silent && vehicle.age_s !== null ? ` (unheard for ${Math.round(vehicle.age_s)} s)` : "";
      context.font = "600 12px system-ui, sans-serif";
      context.lineWidth = 3;
      context.strokeStyle = this.options.dark ? "#101418" : "#fff";
      // A name that would end outside the map is written to the left of its vehicle.
      const width_px = context.measureText(vehicle.name + unheard).width;
      const text_x = x + 11 + width_px > context.canvas.clientWidth ? x - 11 - width_px : x + 11;
      context.strokeText(vehicle.name + unheard, text_x, y + 4);
      context.fillStyle = this.ink;
      context.fillText(vehicle.name + unheard, text_x, y + 4);
      context.globalAlpha = 1;
    },
    zoom_by(factor) {
      this.has_moved = true;
      this.view.scale *= factor;
      this.draw_soon();
    },
    zoomed(event) {
      event.preventDefault();
      this.zoom_by(Math.exp(-event.deltaY / 400));
    },
    pressed(event) {
      this.pointers.set(event.pointerId, [event.clientX, event.clientY]);
      this.$refs.canvas.setPointerCapture(event.pointerId);
      this.dragged_px = 0;
    },
    moved(event) {
      const last = this.pointers.get(event.pointerId);
      if (!last) return;
      const now = [event.clientX, event.clientY];
      const others = [...this.pointers].filter(([id]) => id !== event.pointerId).map(([, at]) => at);
      if (others.length) {
        const before = Math.hypot(last[0] - others[0][0], last[1] - others[0][1]);
        const after = Math.hypot(now[0] - others[0][0], now[1] - others[0][1]);
        if (before > 0) this.zoom_by(after / before);
      } else {
        this.dragged_px += Math.hypot(now[0] - last[0], now[1] - last[1]);
        this.pan(now[0] - last[0], now[1] - last[1]);
      }
      this.pointers.set(event.pointerId, now);
    },
    released(event) {
      this.pointers.delete(event.pointerId);
      if (this.dragged_px > 4 || !this.area) return;
      const box = this.$refs.canvas.getBoundingClientRect();
      const at = [event.clientX - box.left, event.clientY - box.top];
      if (this.options.places) return this.put(this.where(at));
      let nearest = null, least = 24;
      for (const vehicle of Object.values(this.vehicles)) {
        if (!vehicle.position) continue;
        const [x, y] = this.place(vehicle.position), away = Math.hypot(x - at[0], y - at[1]);
        if (away < least) [nearest, least] = [vehicle.name, away];
      }
      this.$emit("choose", { vehicle: nearest ?? "" });
    },
    // Places are chosen in the set-up: by a click, or by the arrow keys and Enter.
    where([x, y]) {
      const box = this.$refs.canvas, ratio = window.devicePixelRatio || 1, { scale } = this.view;
      return [
        this.view.east + (x - box.width / ratio / 2) / scale,
        this.view.north - (y - box.height / ratio / 2) / scale,
      ];
    },
    put([east, north]) {
      const size = this.area.cell_size_m;
      this.cursor = [Math.floor(north / size), Math.floor(east / size)];
      this.draw_soon();
      this.$emit("place", { east, north });
    },
    keyed_place(event) {
      const steps = { ArrowLeft: [0, -1], ArrowRight: [0, 1], ArrowUp: [1, 0], ArrowDown: [-1, 0] };
      const step = steps[event.key], [row, col] = this.cursor ?? [0, 0];
      if (step) this.cursor = this.cursor ? [row + step[0], col + step[1]] : [0, 0];
      else if (event.key === "Enter" || event.key === " ") this.put(this.centre([row, col]));
      else return false;
      this.draw_soon();
      return true;
    },
    draw_cursor(context) {
      const cell = this.area.cell_size_m * this.view.scale, [x, y] = this.place(this.centre(this.cursor));
      context.strokeStyle = "#0072b2";
      context.lineWidth = 3;
      context.strokeRect(x - cell / 2, y - cell / 2, cell, cell);
    },
    pan(x, y) {
      this.has_moved = true;
      this.view.east -= x / this.view.scale;
      this.view.north += y / this.view.scale;
      this.draw_soon();
    },
    keyed(event) {
      if (this.options.places && !event.shiftKey && this.keyed_place(event)) {
        event.preventDefault();
        event.stopPropagation();
        return;
      }
      const steps = { ArrowLeft: [40, 0], ArrowRight: [-40, 0], ArrowUp: [0, 40], ArrowDown: [0, -40] };
      if (steps[event.key]) this.pan(...steps[event.key]);
      else if (event.key === "+") this.zoom_by(1.25);
      else if (event.key === "-") this.zoom_by(0.8);
      else if (event.key === "0") {
        this.has_moved = false;
        this.fit();
      } else return;
      event.preventDefault();
      event.stopPropagation();
    },
  },
};
