// The marks on the cells: goals and fence, strikes, routes and tracks, vehicles, and who hears whom.

export default {
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
  // A light edge keeps red legible on dark cells, for colour-blind readers too.
  stroke_edged(context, colour, width) {
    context.strokeStyle = "#fff";
    context.lineWidth = width + 2;
    context.stroke();
    context.strokeStyle = colour;
    context.lineWidth = width;
    context.stroke();
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
  draw_strikes(context) {
    for (const strike of this.strikes) {
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
  draw_routes(context, vehicle) {
    this.line(context, vehicle.track, vehicle.colour, 2.5);
    if (vehicle.route) this.line(context, vehicle.route.points, vehicle.colour, 1.5, [7, 5]);
  },
  // The paper's sensor sees the 3 × 3 cells around the vehicle: those with centres in this square.
  draw_footprint(context, vehicle) {
    if (!vehicle.position || vehicle.is_silent || !(vehicle.height_m > 1)) return;
    const [x, y] = this.place(vehicle.position), half = 1.5 * this.area.cell_size_m * this.view.scale;
    context.strokeStyle = vehicle.colour;
    context.lineWidth = 1;
    context.setLineDash([2, 3]);
    context.strokeRect(x - half, y - half, 2 * half, 2 * half);
    context.setLineDash([]);
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
    context.globalAlpha = 1;
  },
};
