// What part of the area the canvas shows, and what pointers and keys do with it: move, zoom, choose, place.

const MARGIN_PX = 28;

export default {
  fit() {
    const canvas = this.$refs.canvas, box = this.$el.getBoundingClientRect();
    const ratio = window.devicePixelRatio || 1;
    canvas.width = Math.max(1, Math.round(box.width * ratio));
    canvas.height = Math.max(1, Math.round(box.height * ratio));
    canvas.style.width = `${box.width}px`;
    canvas.style.height = `${box.height}px`;
    if (this.area && !this.has_moved) {
      const { rows, cols, cell_size_m, fence } = this.area;
      const corners = [[0, 0], [cols * cell_size_m, rows * cell_size_m], ...fence];
      const easts = corners.map(([east]) => east), norths = corners.map(([, north]) => north);
      const [west, east, south, north] = [Math.min(...easts), Math.max(...easts), Math.min(...norths), Math.max(...norths)];
      const margin = this.options.margin_px ?? MARGIN_PX;
      const width = Math.max(box.width - 2 * margin, 1), height = Math.max(box.height - 2 * margin, 1);
      this.view.scale = Math.min(width / (east - west), height / (north - south));
      this.view.east = (west + east) / 2;
      this.view.north = (south + north) / 2;
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
  // Places are chosen in the set-up: by a click, or by the arrow keys and Enter.
  where([x, y]) {
    const box = this.$refs.canvas, ratio = window.devicePixelRatio || 1, { scale } = this.view;
    return [
      this.view.east + (x - box.width / ratio / 2) / scale,
      this.view.north - (y - box.height / ratio / 2) / scale,
    ];
  },
  centre([row, col]) {
    const size = this.area.cell_size_m;
    return [(col + 0.5) * size, (row + 0.5) * size];
  },
  pan(x, y) {
    this.has_moved = true;
    this.view.east -= x / this.view.scale;
    this.view.north += y / this.view.scale;
    this.draw_soon();
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
  put([east, north]) {
    const size = this.area.cell_size_m;
    this.cursor = [Math.floor(north / size), Math.floor(east / size)];
    this.draw_soon();
    this.$emit("place", { east, north });
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
};
