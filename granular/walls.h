// granopt: packings between two walls.

#ifndef GRANOPT_GRANULAR_WALLS_H_
#define GRANOPT_GRANULAR_WALLS_H_

#include <functional>
#include <string>
#include <vector>

#include "granular/quasistatic_shear.h"
#include "granular/relaxation.h"

namespace granopt {

// Two walls across the second direction, made of grains that do not move by
// themselves (ContactEnergyOptions::fixed). The cell stays periodic; the upper
// wall and the lower one of the next cell are too far apart to touch.
struct Walls {
  std::vector<int> side;  // N: -1 the lower wall, 1 the upper one, 0 free
  double lower = 0.0, upper = 0.0;  // x_2 of their faces
  double area = 0.0;                // of a face: L_1 in 2D, L_1 L_3 in 3D

  double Height() const { return upper - lower; }
  double Volume() const { return area * Height(); }
  std::vector<bool> Fixed() const;
};

// Rough walls, cut from the packing itself: the grains whose centres lie in the
// lowest and in the highest `thickness` (a length, at least the largest
// diameter) of the cell, whose species becomes "wall". A relaxed packing stays
// relaxed. Returns false with one line in `error` for a cell that is not
// rectangular or walls that are too thin or too thick.
bool MakeRoughWalls(double thickness,
                    Packing* packing,
                    Walls* walls,
                    std::string* error);

// Flat walls: rows (in 3D square layers) of equal discs whose radius is the
// smallest one and whose centres are `spacing` radii apart at most, outside of
// the cell: their faces touch it. The packing is no longer relaxed. The walls
// deviate from a plane by r (1 - (1 - spacing^2 / 4)^(1/2)), 3 % of r at a
// spacing of 0.5 (in 3D along the lines of centres). Their grains come last and
// are of species "wall". Returns false with one line in `error` as above, or
// where they would be more than a packing holds.
bool MakeFlatWalls(double spacing,
                   Packing* packing,
                   Walls* walls,
                   std::string* error);

// What the grains do to a wall: the force on its grains.
struct WallForces {
  SmallVector lower, upper;  // d
};
WallForces MeasureWallForces(const Walls& walls,
                             const std::vector<Contact>& contacts,
                             int dimension);

struct WallShearOptions {
  // `fixed` is set by the walls.
  ContactEnergyOptions energy;
  SolveOptions solve;
  // The upper wall moves by gamma_k H along the first direction, H the height
  // between the faces; strains of steps 1, 2, ...
  std::vector<double> path;
};

struct WallShearStep {
  int step = 0;
  double strain = 0.0;
  // Of the upper wall, positive where it resists: -F_1 / area; and the pressure
  // on it, F_2 / area.
  double shear_stress = 0.0;
  double normal_stress = 0.0;
  // -F dx with the mean of the forces before and after.
  double work = 0.0;
  double dissipated = 0.0;
  // |sum of the forces on both walls| / (area normal_stress): 0 in equilibrium.
  double imbalance = 0.0;
  // Stress (10) and fabric (2) of the contacts, over the volume between the
  // faces.
  const Relaxation* result = nullptr;
  // Valid during the call: what comes after it depends on.
  const QuasistaticShearState* state = nullptr;
};

// Moves the upper wall step by step, the free grains affinely with it, and
// minimizes the energy after each step; the start is relaxed first (step 0).
//
// `state` is where a run stands; one begins with state->packing = the start and
// state->step = -1, and goes on, to the same bits, from a copy that an observer
// was shown. Its stress is that on the upper wall: entry (1, 2) is minus the
// shear stress, (2, 2) the normal one. `last` is the last relaxation, empty if
// nothing was left to do.
//
// Returns false with one line in `error` if the packing cannot be simulated or
// the observer (may be empty) stopped.
bool ShearBetweenWalls(
    const Walls& walls,
    const WallShearOptions& options,
    const Solver& solver,
    const std::function<bool(const WallShearStep&)>& observer,
    QuasistaticShearState* state,
    Relaxation* last,
    std::string* error);

}  // namespace granopt

#endif  // GRANOPT_GRANULAR_WALLS_H_
