#include "granular/walls.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "solvers/format.h"

namespace granopt {
namespace {

// Between the walls of neighbouring cells, in largest radii.
constexpr double kApart = 2.5;

bool IsRectangular(const Packing& packing, std::string* error) {
  const SmallMatrix& h = packing.box.edges();
  for (int r = 0; r < h.rows(); ++r) {
    for (int c = 0; c < h.cols(); ++c) {
      if (r == c ? h(r, c) > 0.0 : h(r, c) == 0.0) continue;
      *error = "walls need a rectangular cell";
      return false;
    }
  }
  return true;
}

double Area(const Box& box) { return box.Volume() / box.edges()(1, 1); }

// Longer along x_2, grains shifted by `below`.
void Extend(double below, double above, Packing* packing) {
  SmallMatrix edges = packing->box.edges();
  edges(1, 1) += below + above;
  packing->box = Box(edges);
  if (below == 0.0) return;
  for (int i = 0; i < packing->size(); ++i) {
    packing->SetPosition(i, 1, packing->Position(i, 1) + below);
  }
}

}  // namespace

std::vector<bool> Walls::Fixed() const {
  std::vector<bool> fixed(side.size());
  for (std::size_t i = 0; i < side.size(); ++i) fixed[i] = side[i] != 0;
  return fixed;
}

bool MakeRoughWalls(double thickness,
                    Packing* packing,
                    Walls* walls,
                    std::string* error) {
  if (!IsRectangular(*packing, error)) return false;
  const double height = packing->box.edges()(1, 1);
  const double largest = packing->radii.maxCoeff();
  if (!(thickness >= 2.0 * largest) || !(thickness < 0.4 * height)) {
    *error = Format("walls of thickness %g must be in [%g, %g]",
                    thickness,
                    2.0 * largest,
                    0.4 * height);
    return false;
  }
  packing->Wrap();
  *walls = Walls();
  walls->side.assign(packing->size(), 0);
  packing->species.resize(packing->size(), "A");
  for (int i = 0; i < packing->size(); ++i) {
    const double y = packing->positions(1, i);
    walls->side[i] = y < thickness ? -1 : y >= height - thickness ? 1 : 0;
    if (walls->side[i] != 0) packing->species[i] = "wall";
  }
  walls->lower = thickness;
  walls->upper = height - thickness;
  walls->area = Area(packing->box);
  Extend(0.0, kApart * largest, packing);
  return true;
}

bool MakeFlatWalls(double spacing,
                   Packing* packing,
                   Walls* walls,
                   std::string* error) {
  if (!IsRectangular(*packing, error)) return false;
  if (!(spacing > 0.0 && spacing <= 1.0)) {
    *error = Format("spacing = %g must be in (0, 1]", spacing);
    return false;
  }
  const int d = packing->dimension();
  const int n = packing->size();
  const double radius = packing->radii.minCoeff();
  const double largest = packing->radii.maxCoeff();
  const SmallMatrix edges = packing->box.edges();
  double counts[2] = {1.0, 1.0}, step[2] = {0.0, 0.0};
  const int along[2] = {0, 2};
  for (int k = 0; k < d - 1; ++k) {
    const double length = edges(along[k], along[k]);
    counts[k] = std::ceil(length / (spacing * radius));
    step[k] = length / counts[k];
  }
  if (!(n + 2.0 * counts[0] * counts[1] <= kMostGrains)) {
    *error = Format("walls of %g x %g grains are too many for a packing",
                    counts[0],
                    counts[1]);
    return false;
  }
  const int count[2] = {static_cast<int>(counts[0]),
                        static_cast<int>(counts[1])};
  const int of_a_wall = count[0] * count[1];
  packing->Wrap();
  *walls = Walls();
  walls->area = Area(packing->box);
  const double below = 2.0 * radius;
  Extend(below, below + kApart * largest, packing);
  walls->lower = below;
  walls->upper = below + edges(1, 1);

  Packing all;
  all.box = packing->box;
  all.attributes = packing->attributes;
  const int total = n + 2 * of_a_wall;
  all.positions.resize(d, total);
  all.positions.leftCols(n) = packing->positions;
  all.positions_low.setZero(d, total);
  if (packing->positions_low.size() > 0) {
    all.positions_low.leftCols(n) = packing->positions_low;
  }
  all.radii.resize(total);
  all.radii.head(n) = packing->radii;
  all.radii.tail(2 * of_a_wall).setConstant(radius);
  if (packing->stiffness.size() > 0) {
    all.stiffness.setOnes(total);
    all.stiffness.head(n) = packing->stiffness;
  }
  all.species = packing->species;
  all.species.resize(n, "A");
  all.species.resize(total, "wall");
  walls->side.assign(total, 0);
  int next = n;
  for (const int side : {-1, 1}) {
    const double y = side < 0 ? walls->lower - radius : walls->upper + radius;
    for (int a = 0; a < count[0]; ++a) {
      for (int b = 0; b < count[1]; ++b) {
        all.positions(0, next) = a * step[0];
        all.positions(1, next) = y;
        if (d == 3) all.positions(2, next) = b * step[1];
        walls->side[next++] = side;
      }
    }
  }
  *packing = std::move(all);
  return true;
}

WallForces MeasureWallForces(const Walls& walls,
                             const std::vector<Contact>& contacts,
                             int dimension) {
  WallForces forces;
  forces.lower = SmallVector::Zero(dimension);
  forces.upper = SmallVector::Zero(dimension);
  for (const Contact& c : contacts) {
    const SmallVector on_i = c.force * c.normal;
    for (const auto& [grain, sign] :
         {std::make_pair(c.id.i, 1.0), std::make_pair(c.id.j, -1.0)}) {
      if (walls.side[grain] < 0) forces.lower += sign * on_i;
      if (walls.side[grain] > 0) forces.upper += sign * on_i;
    }
  }
  return forces;
}

bool ShearBetweenWalls(
    const Walls& walls,
    const WallShearOptions& options,
    const Solver& solver,
    const std::function<bool(const WallShearStep&)>& observer,
    QuasistaticShearState* state,
    Relaxation* last,
    std::string* error) {
  for (const double strain : options.path) {
    if (std::isfinite(strain)) continue;
    *error = Format("strain = %g must be finite", strain);
    return false;
  }
  if (static_cast<int>(walls.side.size()) != state->packing.size()) {
    *error = "walls of another packing";
    return false;
  }
  const int d = state->packing.dimension();
  ContactEnergyOptions energy = options.energy;
  energy.fixed = walls.Fixed();
  *last = Relaxation();
  while (state->step < static_cast<int>(options.path.size())) {
    WallShearStep step;
    step.step = state->step + 1;
    step.strain = step.step > 0 ? options.path[step.step - 1] : 0.0;
    const double move = (step.strain - state->strain) * walls.Height();
    Packing packing = state->packing;
    for (int i = 0; i < packing.size() && move != 0.0; ++i) {
      if (walls.side[i] < 0) continue;
      const double part =
          walls.side[i] > 0
              ? 1.0
              : std::clamp(
                    (packing.positions(1, i) - walls.lower) / walls.Height(),
                    0.0,
                    1.0);
      packing.SetPosition(i, 0, packing.Position(i, 0) + part * move);
    }
    Relaxation relaxed;
    if (!Relax(packing, energy, solver, options.solve, &relaxed, error)) {
      return false;
    }
    // Over the volume between the faces.
    Observables& o = relaxed.observables;
    const double volumes = packing.box.Volume() / walls.Volume();
    o.stress *= volumes;
    o.fabric *= volumes;
    o.pressure *= volumes;
    o.shear_stress *= volumes;
    o.stress_parts = SplitTensor(o.stress);
    o.fabric_parts = SplitTensor(o.fabric);
    const WallForces forces = MeasureWallForces(walls, relaxed.contacts, d);
    SmallMatrix stress = SmallMatrix::Zero(d, d);
    stress.col(1) = forces.upper / walls.area;
    step.shear_stress = 0.0 - stress(0, 1);  // no -0
    step.normal_stress = stress(1, 1);
    const double push = std::abs(forces.upper[1]);
    step.imbalance =
        push > 0.0 ? (forces.upper + forces.lower).norm() / push : 0.0;
    if (step.step > 0) {
      step.work =
          -0.5 * walls.area * (state->stress(0, 1) + stress(0, 1)) * move;
      step.dissipated = state->energy + step.work - o.energy;
    }
    state->step = step.step;
    state->strain = step.strain;
    state->packing = relaxed.packing;
    state->energy = o.energy;
    state->stress = stress;
    ++state->relaxations;
    state->gave_up += relaxed.summary.Succeeded() ? 0 : 1;
    state->counters += relaxed.summary.counters;
    state->seconds += relaxed.summary.seconds;
    *last = std::move(relaxed);
    step.result = last;
    step.state = state;
    if (observer && !observer(step)) {
      *error = "stopped by the caller";
      return false;
    }
  }
  return true;
}

}  // namespace granopt
