// Groups in formation: lines that show the shape, a ring around the leader, and the members' errors.

const LEAST_ERROR_M = 2; // a member in its place has no circle

// The shortest lines that join all places: the arms of a wedge, a row, or most of a ring.
function joined(places) {
  const lines = [], outside = places.slice(1), inside = places.slice(0, 1);
  while (outside.length) {
    let best = [Infinity];
    for (const from of inside) {
      for (const to of outside) {
        const away = Math.hypot(to[0] - from[0], to[1] - from[1]);
        if (away < best[0]) best = [away, from, to];
      }
    }
    lines.push(best.slice(1));
    inside.push(best[2]);
    outside.splice(outside.indexOf(best[2]), 1);
  }
  return lines;
}

export default {
  draw_groups(context) {
    for (const group of this.groups) {
      const members = group.members.map((name) => this.vehicles[name]).filter((vehicle) => vehicle?.position);
      for (const points of joined(members.map((vehicle) => vehicle.position))) {
        this.line(context, points, this.options.dark ? "#000" : "#fff", 5);
        this.line(context, points, this.ink, 2);
      }
      for (const vehicle of members) {
        const error_m = group.errors_m[group.members.indexOf(vehicle.name)];
        if (error_m >= LEAST_ERROR_M) this.draw_error(context, vehicle, error_m);
        if (vehicle.name === group.leader) this.draw_leader(context, vehicle);
      }
    }
  },
  // The place of the member is somewhere on this circle: a member tells how far it is, not where.
  draw_error(context, vehicle, error_m) {
    const [x, y] = this.place(vehicle.position);
    context.beginPath();
    context.arc(x, y, error_m * this.view.scale, 0, 2 * Math.PI);
    context.setLineDash([1, 3]);
    context.strokeStyle = this.ink;
    context.lineWidth = 1.5;
    context.stroke();
    context.setLineDash([]);
  },
  draw_leader(context, vehicle) {
    const [x, y] = this.place(vehicle.position);
    context.beginPath();
    context.arc(x, y, 15, 0, 2 * Math.PI);
    this.stroke_edged(context, vehicle.colour, 3);
  },
};
