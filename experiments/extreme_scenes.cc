#include "experiments/extreme_scenes.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>

#include "experiments/scene.h"
#include "granular/jamming.h"
#include "granular/packing_generator.h"
#include "granular/relaxation.h"
#include "solvers/format.h"
#include "solvers/registry.h"

namespace granopt {
namespace {

constexpr int kGrains = 128;
constexpr std::uint64_t kSeed = 5;

using Build = std::function<bool(ExtremeStart*, std::string*)>;

struct Entry {
  ExtremeScene scene;
  Build build;
};

bool Random(int particles,
            double phi,
            int dimension,
            ExtremeStart* start,
            std::string* error) {
  GeneratorOptions options;
  options.dimension = dimension;
  options.particles = particles;
  options.packing_fraction = phi;
  options.seed = kSeed;
  return GeneratePacking(options, &start->packing, error);
}

// A random start of the usual size, above jamming.
bool Usual(ExtremeStart* start, std::string* error) {
  return Random(kGrains, 0.88, 2, start, error);
}

// phi_J + distance, sheared by 0.3 distance from the state there.
bool AtDistance(double distance,
                double alpha,
                ExtremeStart* start,
                std::string* error) {
  if (!Random(kGrains, 0.88, 2, start, error)) return false;
  start->energy.alpha = alpha;
  const std::unique_ptr<Solver> solver = CreateSolver(kDefaultSolver, error);
  if (solver == nullptr) return false;
  Relaxation relaxed;
  SolveOptions solve;
  solve.relative_tolerance = 1e-10;
  if (!Relax(start->packing, start->energy, *solver, solve, &relaxed, error)) {
    return false;
  }
  JammingOptions options;
  options.energy = start->energy;
  options.solve.relative_tolerance = 1e-8;
  options.solve.vanishing_tolerance = 1e-10;
  options.phi_init = 0.0;
  options.error_bar = std::min(1e-8, 0.1 * distance);
  options.until_isostatic = false;
  JammingResult jamming;
  if (!FindJamming(
          relaxed.packing, options, *solver, nullptr, &jamming, error)) {
    return false;
  }
  start->packing = jamming.jammed.packing;
  start->packing.SetPackingFraction(jamming.phi_j + distance);
  start->packing.Deform(SimpleShear(2, 0.3 * std::min(distance, 0.1)));
  start->vanishing_tolerance = std::min(1e-13, 1e-3 * distance);
  return true;
}

// A relaxed packing in other units, then sheared a little.
bool Scaled(double stiffness,
            double length,
            double alpha,
            ExtremeStart* start,
            std::string* error) {
  if (!Usual(start, error)) return false;
  start->energy.alpha = alpha;
  start->energy.stiffness = stiffness;
  start->packing.Deform(length * SmallMatrix::Identity(2, 2));
  start->packing.ScaleRadii(length);
  return true;
}

void SetSquare(int side, double spacing, ExtremeStart* start) {
  Packing& packing = start->packing;
  packing = Packing();
  packing.box = Box::Cube(2, side * spacing);
  packing.positions.resize(2, side * side);
  for (int i = 0; i < side * side; ++i) {
    packing.positions(0, i) = spacing * (i % side);
    packing.positions(1, i) = spacing * (i / side);
  }
  packing.radii.setConstant(side * side, 0.5);
}

// Small discs around few large ones.
bool WithRatio(double ratio, ExtremeStart* start, std::string* error) {
  GeneratorOptions options;
  options.particles = kGrains;
  // Above jamming: small grains fill the space between large ones.
  options.packing_fraction = 0.95;
  options.seed = kSeed;
  options.species = {{"A", 1.0 - 2.0 / kGrains, 1.0},
                     {"B", 2.0 / kGrains, ratio}};
  return GeneratePacking(options, &start->packing, error);
}

std::vector<Entry> MakeEntries() {
  std::vector<Entry> entries;
  const auto add = [&entries](const std::string& group,
                              const std::string& name,
                              const std::string& what,
                              const Build& build,
                              bool smoke = false,
                              bool large = false) {
    entries.push_back({{name, group, what, smoke, large}, build});
  };

  const std::string distance = "distance from jamming";
  for (const double x :
       {1e-14, 1e-12, 1e-10, 1e-8, 1e-6, 1e-4, 1e-2, 1e-1, 1.0}) {
    const bool smoke = x == 1e-12 || x == 1e-6 || x == 1.0;
    add(
        distance,
        Format("distance_%g", x),
        Format("phi_J + %g, sheared by 0.3 of that", x),
        [x](ExtremeStart* start, std::string* error) {
          return AtDistance(x, 2.0, start, error);
        },
        smoke);
  }
  for (const double x : {1e-10, 1e-6}) {
    add(distance,
        Format("hertz_distance_%g", x),
        Format("alpha = 2.5 at phi_J + %g, sheared by 0.3 of that", x),
        [x](ExtremeStart* start, std::string* error) {
          return AtDistance(x, 2.5, start, error);
        });
  }

  for (const double alpha : {2.0, 2.5, 3.0, 4.0, 6.0, 10.0}) {
    add(
        "exponent",
        Format("alpha_%g", alpha),
        Format("a random start with alpha = %g", alpha),
        [alpha](ExtremeStart* start, std::string* error) {
          start->energy.alpha = alpha;
          return Usual(start, error);
        },
        alpha == 6.0);
  }

  for (const double ratio : {10.0, 100.0, 1e3, 1e4}) {
    add(
        "size ratio",
        Format("size_ratio_%g", ratio),
        Format("two discs %g times as large as 126 others", ratio),
        [ratio](ExtremeStart* start, std::string* error) {
          return WithRatio(ratio, start, error);
        },
        ratio == 1e3);
  }

  for (const double ratio : {1e3, 1e6, 1e12}) {
    add(
        "stiffness ratio",
        Format("stiffness_ratio_%g", ratio),
        Format("every second disc %g times as stiff", ratio),
        [ratio](ExtremeStart* start, std::string* error) {
          if (!Usual(start, error)) return false;
          start->packing.stiffness.setOnes(start->packing.size());
          for (int i = 0; i < start->packing.size(); i += 2) {
            start->packing.stiffness[i] = ratio;
          }
          return true;
        },
        ratio == 1e12);
  }

  const std::string units = "units";
  for (const double k : {1e-300, 1e-150, 1e150, 1e300}) {
    add(
        units,
        Format("stiffness_%g", k),
        Format("k = %g", k),
        [k](ExtremeStart* start, std::string* error) {
          return Scaled(k, 1.0, 2.0, start, error);
        },
        k == 1e-150);
  }
  for (const double length : {1e-100, 1e100}) {
    add(
        units,
        Format("box_%g", length),
        Format("a box of %g", length),
        [length](ExtremeStart* start, std::string* error) {
          return Scaled(1.0, length, 2.0, start, error);
        },
        length == 1e100);
  }
  add(
      units,
      "overflow",
      "a box of 1e100 with alpha = 10: energies near 1e1000",
      [](ExtremeStart* start, std::string* error) {
        return Scaled(1.0, 1e100, 10.0, start, error);
      },
      true);
  add(units,
      "underflow",
      "a box of 1e-100 with alpha = 10: energies near 1e-1000",
      [](ExtremeStart* start, std::string* error) {
        return Scaled(1.0, 1e-100, 10.0, start, error);
      });
  add(units,
      "far_away",
      "centres moved by 1e12 boxes",
      [](ExtremeStart* start, std::string* error) {
        if (!Usual(start, error)) return false;
        start->packing.positions.array() += 1e12;
        return true;
      });

  const std::string cell = "cell";
  for (const double aspect : {10.0, 100.0, 1000.0}) {
    add(
        cell,
        Format("aspect_%g", aspect),
        Format("a cell %g times as long as high, 2000 discs", aspect),
        [aspect](ExtremeStart* start, std::string* error) {
          if (!Random(2000, 0.88, 2, start, error)) return false;
          // Centres keep their fractions of the cell; radii keep their area.
          const double root = std::sqrt(aspect);
          SmallMatrix stretch = SmallMatrix::Zero(2, 2);
          stretch(0, 0) = root;
          stretch(1, 1) = 1.0 / root;
          start->packing.Deform(stretch);
          return true;
        },
        aspect == 100.0);
  }
  for (const double shear : {0.5, 1.0, 3.0, 10.0}) {
    add(
        cell,
        Format("shear_%g", shear),
        Format("sheared by %g", shear),
        [shear](ExtremeStart* start, std::string* error) {
          if (!Usual(start, error)) return false;
          start->packing.Deform(SimpleShear(2, shear));
          return true;
        },
        shear == 10.0);
  }

  const std::string count = "number of grains";
  for (const int n : {1, 2, 3, 10, 1024, 10000, 100000, 1000000}) {
    add(
        count,
        Format("grains_%d", n),
        Format("%d disc%s", n, n == 1 ? "" : "s"),
        [n](ExtremeStart* start, std::string* error) {
          return Random(n, n == 1 ? 0.5 : 0.88, 2, start, error);
        },
        n <= 3,
        n >= 10000);
  }
  add(count,
      "spheres",
      "128 spheres",
      [](ExtremeStart* start, std::string* error) {
        return Random(kGrains, 0.7, 3, start, error);
      });

  const std::string places = "special places";
  add(
      places,
      "coincident_pair",
      "two discs at one place",
      [](ExtremeStart* start, std::string* error) {
        if (!Usual(start, error)) return false;
        start->packing.positions.col(1) = start->packing.positions.col(0);
        return true;
      },
      true);
  add(places,
      "nearly_coincident",
      "two discs at a distance of 1e-300",
      [](ExtremeStart* start, std::string* error) {
        if (!Usual(start, error)) return false;
        start->packing.positions.col(0).setZero();
        start->packing.positions.col(1).setZero();
        start->packing.positions(0, 1) = 1e-300;
        return true;
      });
  add(places,
      "all_coincident",
      "every disc at one place",
      [](ExtremeStart* start, std::string* error) {
        if (!Usual(start, error)) return false;
        start->packing.positions.setConstant(0.25);
        return true;
      });
  add(
      places,
      "square_lattice",
      "an exact square lattice, compressed: stationary, no minimum",
      [](ExtremeStart* start, std::string*) {
        SetSquare(10, 0.97, start);
        return true;
      },
      true);
  add(places,
      "square_lattice_touching",
      "an exact square lattice of discs that just touch",
      [](ExtremeStart* start, std::string*) {
        SetSquare(10, 1.0, start);
        return true;
      });
  add(places,
      "nearly_square",
      "that lattice, moved by 1e-12",
      [](ExtremeStart* start, std::string*) {
        SetSquare(10, 0.97, start);
        start->packing.Perturb(1e-12, kSeed);
        return true;
      });
  add(places,
      "column",
      "a straight column of discs, squeezed: about to buckle",
      [](ExtremeStart* start, std::string*) {
        Packing& packing = start->packing;
        packing.box = Box((SmallMatrix(2, 2) << 9.9, 0.0, 0.0, 5.0).finished());
        packing.positions.setZero(2, 10);
        for (int i = 0; i < 10; ++i) packing.positions(0, i) = 0.99 * i;
        packing.radii.setConstant(10, 0.5);
        return true;
      });
  add(
      places,
      "all_rattlers",
      "a random start at phi = 0.3",
      [](ExtremeStart* start, std::string* error) {
        return Random(kGrains, 0.3, 2, start, error);
      },
      true);
  add(places,
      "overlapping_images",
      "phi = 2: discs reach their second neighbours",
      [](ExtremeStart* start, std::string* error) {
        return Random(kGrains, 2.0, 2, start, error);
      });
  add(places,
      "own_image",
      "three discs so large that each touches its own image",
      [](ExtremeStart* start, std::string* error) {
        return Random(3, 2.5, 2, start, error);
      });
  return entries;
}

const std::vector<Entry>& Entries() {
  static const std::vector<Entry>* const entries =
      new std::vector<Entry>(MakeEntries());
  return *entries;
}

}  // namespace

const std::vector<ExtremeScene>& ExtremeScenes() {
  static const std::vector<ExtremeScene>* const scenes = [] {
    auto* all = new std::vector<ExtremeScene>;
    for (const Entry& entry : Entries()) all->push_back(entry.scene);
    return all;
  }();
  return *scenes;
}

bool MakeExtremeStart(const std::string& name,
                      ExtremeStart* start,
                      std::string* error) {
  *start = ExtremeStart();
  for (const Entry& entry : Entries()) {
    if (entry.scene.name == name) return entry.build(start, error);
  }
  *error = "unknown extreme '" + name + "' (--list names them)";
  return false;
}

}  // namespace granopt
