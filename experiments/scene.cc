#include "experiments/scene.h"

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <vector>

#include "experiments/run.h"
#include "granular/packing_generator.h"
#include "granular/packing_io.h"
#include "solvers/registry.h"
#include "solvers/threads.h"

DEFINE_string(input,
              "",
              "extended XYZ file to start from (instead of a random start)");
DEFINE_int32(
    particles,
    1024,
    "grains of a random start, half of them --size_ratio times larger");
DEFINE_int32(dimension, 2, "dimension of a random start: 2 or 3");
DEFINE_double(
    size_ratio,
    1.4,
    "of a random start, radii of one half over those of the other; 1: "
    "all alike");
DEFINE_double(polydispersity,
              0.0,
              "w: every radius of a random start times a uniform factor in "
              "[1 - w, 1 + w]");
DEFINE_double(alpha,
              2.0,
              "exponent of the contact energy k delta^alpha / alpha, >= 2; "
              "default: the input's own alpha, else 2");
DEFINE_string(precision,
              "double",
              "of gaps and directions of contacts: double; mixed (single until "
              "max|g| < 3.6e-6 mean contact forces, then double); float "
              "(single, for --tolerance >= 1e-5)");
DEFINE_double(tolerance,
              1e-10,
              "stop at max|g| <= tolerance * mean contact force");
DEFINE_double(
    zero_pressure,
    1e-13,
    "unjammed if (p / (k r^(alpha-d)))^(1/(alpha-1)) and mean overlap / r "
    "are below this (about a distance in phi)");
DEFINE_int32(
    threads,
    1,
    "threads for energies, lists of neighbours and first-order methods "
    "of more than 4096 grains; results are the same bits");
DEFINE_bool(list_solvers,
            false,
            "print the methods with their options and exit");

namespace granopt {

const char kDefaultSolver[] = "auto";

void ListSolversIfAsked() {
  if (!FLAGS_list_solvers) return;
  std::fputs(SolverTable().c_str(), stdout);
  std::exit(kConverged);
}

std::unique_ptr<Solver> MakeSolver(const char* flag, const std::string& spec) {
  std::string error;
  std::unique_ptr<Solver> solver = CreateSolver(spec, &error);
  if (solver == nullptr) BadInput(std::string("--") + flag + ": " + error);
  return solver;
}

Scene MakeScene(double phi, std::uint64_t seed) {
  Scene scene;
  std::string error;
  CheckPositive("tolerance", FLAGS_tolerance);
  CheckPositive("zero_pressure", FLAGS_zero_pressure);
  if (FLAGS_threads < 1 || FLAGS_threads > 1024) {
    BadInput(Format("--threads=%d must be in [1, 1024]", FLAGS_threads));
  }
  if (!SetNumThreads(FLAGS_threads)) {
    BadInput(Format("--threads=%d: built without OpenMP", FLAGS_threads));
  }

  if (IsGiven("input") && FLAGS_input.empty()) BadInput("--input= is empty");
  if (!FLAGS_input.empty()) {
    for (const char* flag :
         {"particles", "dimension", "polydispersity", "size_ratio"}) {
      if (IsGiven(flag)) {
        BadInput(std::string("--") + flag +
                 " describes a random start and cannot go with --input");
      }
    }
    if (!ReadPacking(FLAGS_input, &scene.packing, &error)) {
      BadInput("--input: " + error);
    }
    scene.origin = FLAGS_input;
  } else {
    GeneratorOptions options;
    options.dimension = FLAGS_dimension;
    options.particles = FLAGS_particles;
    options.packing_fraction = phi;
    options.seed = seed;
    options.polydispersity = FLAGS_polydispersity;
    CheckRange("size_ratio", FLAGS_size_ratio, 0.01, 100.0);
    options.species[1].relative_radius = FLAGS_size_ratio;
    if (!GeneratePacking(options, &scene.packing, &error))
      BadInput("--" + error);
    scene.origin = "seed " + std::to_string(seed);
  }

  // The file may say which law it was made with.
  const auto attribute = [&scene](const char* key, double fallback) {
    const auto found = scene.packing.attributes.find(key);
    if (found == scene.packing.attributes.end()) return fallback;
    char* end = nullptr;
    const double value = std::strtod(found->second.c_str(), &end);
    if (found->second.empty() || *end != '\0' || !std::isfinite(value)) {
      BadInput("--input: " + FLAGS_input + ":2: " + key + "=" + found->second +
               " is not a number");
    }
    return value;
  };
  scene.energy.alpha =
      IsGiven("alpha") ? FLAGS_alpha : attribute("alpha", FLAGS_alpha);
  scene.energy.stiffness = attribute("k", 1.0);
  if (!(scene.energy.alpha >= 2.0 && scene.energy.alpha <= 100.0)) {
    BadInput(Format("--alpha=%g must be in [2, 100]", scene.energy.alpha));
  }
  bool is_known = false;
  for (const Precision precision :
       {Precision::DOUBLE, Precision::MIXED, Precision::FLOAT}) {
    if (FLAGS_precision != PrecisionName(precision)) continue;
    scene.energy.precision = precision;
    is_known = true;
  }
  if (!is_known) {
    BadInput("--precision=" + FLAGS_precision +
             " must be double, mixed or float");
  }
  CheckScene(scene);
  return scene;
}

void CheckScene(const Scene& scene) {
  std::string error;
  const auto energy =
      ContactEnergy::Create(scene.packing, scene.energy, &error);
  if (energy == nullptr) BadInput(scene.origin + ": " + error);
  const std::vector<double> zero(energy->NumParameters(), 0.0);
  for (const Contact& contact : energy->Contacts(zero.data())) {
    if (contact.distance > 0.0) continue;
    BadInput(scene.origin + Format(": grains %d and %d are at the same place",
                                   contact.id.i,
                                   contact.id.j));
  }
}

void ApplyLoad(const Load& load, std::uint64_t seed, Packing* packing) {
  const int d = packing->dimension();
  if (load.radius_factor != 1.0) packing->ScaleRadii(load.radius_factor);
  if (load.simple_shear != 0.0) {
    packing->Deform(SimpleShear(d, load.simple_shear));
  }
  if (load.pure_shear != 0.0) packing->Deform(PureShear(d, load.pure_shear));
  if (load.perturbation > 0.0) {
    packing->Perturb(load.perturbation * packing->box.Length(), seed);
  }
}

double ForceUnit(const Packing& packing, const ContactEnergyOptions& energy) {
  return energy.stiffness * std::pow(packing.box.Length(), energy.alpha - 1.0);
}

SolveOptions MakeSolveOptions() {
  SolveOptions options;
  options.relative_tolerance = FLAGS_tolerance;
  options.vanishing_tolerance = FLAGS_zero_pressure;
  return options;
}

}  // namespace granopt
