#include "experiments/flow_scene.h"

#include <algorithm>
#include <cmath>

#include "experiments/run.h"
#include "experiments/tabular.h"
#include "granular/atomic_file.h"
#include "granular/flow/start.h"
#include "granular/packing_io.h"
#include "solvers/registry.h"

// ---- the start
DEFINE_double(side, 1.0, "side D of the cube around 0, m");
DEFINE_double(length_ratio,
              0.25,
              "L: radius over D / n^(1/3); volume fraction 4 pi L^3 / 3");
DEFINE_double(density, 2000.0, "of a grain, kg / m^3");
DEFINE_string(mean_velocity, "1,0.1,0.1", "of all grains, m / s");
DEFINE_string(perturbation,
              "1,0.1,0.1",
              "velocities are the mean + this times uniform in [-1, 1]");
DEFINE_int32(attempts,
             10000,
             "places tried for a grain of a random start; 0: the first, "
             "overlaps and all");
DEFINE_bool(relax_overlaps,
            false,
            "first move overlapping grains apart, with --solver on the contact "
            "energy");
// ---- forces
DEFINE_string(law,
              "powers",
              "near field: powers (2.2), mie, lennard_jones, morse or none");
DEFINE_double(alpha1, 0.25, "strength of attraction, per weight^2");
DEFINE_double(beta1, 1.0, "its exponent");
DEFINE_double(alpha2, 0.125, "strength of repulsion, per weight^2");
DEFINE_double(beta2, 2.0, "its exponent, > beta1 for stability (2.8)");
DEFINE_string(weight,
              "mass",
              "what strengths are multiplied by, grain by grain: mass, area "
              "(footnote 14) or one");
DEFINE_double(depth, 1.0, "of the well of mie, lennard_jones and morse");
DEFINE_double(sigma, 0.2, "where the potential of mie, lennard_jones is 0");
DEFINE_double(mie_repulsion, 12.0, "n of mie");
DEFINE_double(mie_attraction, 6.0, "m of mie, < n");
DEFINE_double(morse_steepness, 5.0, "a of morse, 1 / m");
DEFINE_double(morse_distance, 0.3, "of the least potential of morse, m");
DEFINE_double(field_accuracy,
              1e-3,
              "bound of the error of a near-field force, over the sum of the "
              "magnitudes of its pair forces, where many grains make a fast "
              "multipole method worth while");
DEFINE_int32(multipole_from,
             -1,
             "number of grains from which it is used; -1: where it pays, 0: "
             "never");
DEFINE_string(contacts,
              "impact",
              "impact (restitution and friction), soft (energy of overlaps) "
              "or none");
DEFINE_double(restitution, 0.5, "e, or e0 of (5.13)");
DEFINE_bool(velocity_dependent, false, "e = max(e0 (1 - dv/v*), e-) (5.13)");
DEFINE_double(velocity_scale, 1.0, "v* of (5.13), m / s");
DEFINE_double(least_restitution, 0.1, "e- of (5.13)");
DEFINE_double(impact_duration, 0.01, "gamma of (3.18), in time steps");
DEFINE_double(mu_s, 0.2, "coefficient of static friction");
DEFINE_double(mu_d, 0.1, "coefficient of dynamic friction, <= mu_s");
DEFINE_double(stiffness, 1e4, "k of soft contacts, k delta^alpha / alpha");
DEFINE_double(contact_alpha, 2.0, "alpha of soft contacts");
DEFINE_string(gravity, "0,0,0", "constant force per mass, m / s^2");
DEFINE_string(force, "0,0,0", "amplitude of a harmonic force per mass");
DEFINE_double(force_frequency, 0.0, "its angular frequency Omega, 1 / s");
DEFINE_double(damping, 0.0, "d / m of a drag -d v, 1 / s");
DEFINE_string(domain,
              "paper",
              "paper (x -> -x for an outgoing grain, no images), periodic "
              "(nearest image), walls or open");
// ---- steps
DEFINE_string(
    stepper,
    "implicit",
    "implicit (the paper's fixed point), verlet or minimize (the same "
    "step by --solver)");
DEFINE_double(duration, 1.0, "end of the run, s");
DEFINE_double(dt, 0.01, "time step, or its upper limit, s");
DEFINE_double(first_dt, 0.001, "first step of implicit, s");
DEFINE_int32(iterations, 10, "K_d, in which an implicit step must converge");
DEFINE_string(sweep,
              "jacobi",
              "order of updates of implicit: jacobi, gauss_seidel or groups");
DEFINE_int32(groups, 4, "number of groups of --sweep=groups");
DEFINE_double(relaxation, 1.0, "gamma of (6.13)");
DEFINE_double(safety, 0.9, "factor on the step of (6.8)");
DEFINE_string(solver,
              "lbfgs",
              "method of --stepper=minimize and of "
              "--relax_overlaps (see --list_solvers)");

namespace granopt {

namespace {

void ReadVector(const char* flag, const std::string& text, double* v) {
  std::vector<double> values;
  if (!ParseNumbers(text, &values) || values.size() != 3) {
    BadInput(Format("--%s=%s must be three numbers x,y,z", flag, text.c_str()));
  }
  std::copy(values.begin(), values.end(), v);
}

RadialLaw MakeLaw() {
  if (FLAGS_law == "powers") {
    return RadialLaw::Powers(
        FLAGS_alpha1, FLAGS_beta1, FLAGS_alpha2, FLAGS_beta2);
  }
  if (FLAGS_law == "lennard_jones" || FLAGS_law == "mie") {
    const bool is_mie = FLAGS_law == "mie";
    const double n = is_mie ? FLAGS_mie_repulsion : 12.0;
    const double m = is_mie ? FLAGS_mie_attraction : 6.0;
    CheckPositive("depth", FLAGS_depth);
    CheckPositive("sigma", FLAGS_sigma);
    if (!(n > m && m > 0.0)) {
      BadInput(Format(
          "--mie_repulsion=%g must exceed --mie_attraction=%g > 0", n, m));
    }
    return RadialLaw::Mie(FLAGS_depth, FLAGS_sigma, n, m);
  }
  if (FLAGS_law == "morse") {
    return RadialLaw::Morse(
        FLAGS_depth, FLAGS_morse_steepness, FLAGS_morse_distance);
  }
  BadInput("--law=" + FLAGS_law +
           " must be powers, mie, lennard_jones, morse or none");
}

// All but grains.
FlowSceneOptions MakeSceneOptions() {
  FlowSceneOptions options;
  if (!ParseDomain(FLAGS_domain.c_str(), &options.domain.kind)) {
    BadInput("--domain=" + FLAGS_domain +
             " must be paper, periodic, walls or open");
  }
  CheckPositive("side", FLAGS_side);
  options.domain.side = FLAGS_side;
  if (FLAGS_law != "none" &&
      !(FLAGS_law == "powers" && FLAGS_alpha1 == 0.0 && FLAGS_alpha2 == 0.0)) {
    options.near_field = NearFieldOptions();
    options.near_field->law = MakeLaw();
    options.near_field->tree_accuracy = FLAGS_field_accuracy;
    options.near_field->tree_from = FLAGS_multipole_from;
    CheckRange("multipole_from", FLAGS_multipole_from, -1, 2e9);
    CheckRange("field_accuracy", FLAGS_field_accuracy, 1e-9, 0.1);
  }
  if (!ParseWeight(FLAGS_weight, &options.weight)) {
    BadInput("--weight=" + FLAGS_weight + " must be mass, area or one");
  }
  if (FLAGS_contacts == "impact") {
    ImpactOptions impact;
    impact.restitution = FLAGS_restitution;
    impact.is_velocity_dependent = FLAGS_velocity_dependent;
    impact.velocity_scale = FLAGS_velocity_scale;
    impact.least_restitution = FLAGS_least_restitution;
    impact.duration = FLAGS_impact_duration;
    impact.friction = {FLAGS_mu_s, FLAGS_mu_d};
    options.impact = impact;
  } else if (FLAGS_contacts == "soft") {
    for (const char* flag : {"restitution", "mu_s", "mu_d"}) {
      if (IsGiven(flag)) {
        BadInput(std::string("--") + flag +
                 " is of impacts and cannot go with --contacts=soft");
      }
    }
    options.soft_contact = SoftContactOptions();
    options.soft_contact->stiffness = FLAGS_stiffness;
    options.soft_contact->alpha = FLAGS_contact_alpha;
  } else if (FLAGS_contacts != "none") {
    BadInput("--contacts=" + FLAGS_contacts + " must be impact, soft or none");
  }
  ExternalForce external;
  ReadVector("gravity", FLAGS_gravity, external.constant);
  ReadVector("force", FLAGS_force, external.amplitude);
  external.frequency = FLAGS_force_frequency;
  if (!std::isfinite(FLAGS_force_frequency)) {
    BadInput(
        Format("--force_frequency=%g must be finite", FLAGS_force_frequency));
  }
  bool has_external = false;
  for (int k = 0; k < 3; ++k) {
    has_external = has_external || external.constant[k] != 0.0 ||
                   external.amplitude[k] != 0.0;
  }
  if (has_external) options.external = external;
  options.damping = FLAGS_damping;
  return options;
}

}  // namespace

StepperOptions MakeStepperOptions() {
  StepperOptions options;
  CheckPositive("dt", FLAGS_dt);
  CheckPositive("first_dt", FLAGS_first_dt);
  CheckPositive("tolerance", FLAGS_tolerance);
  CheckPositive("duration", FLAGS_duration);
  CheckRange("iterations", FLAGS_iterations, 2, 100000);
  CheckRange("relaxation", FLAGS_relaxation, 1e-3, 2.0);
  CheckRange("safety", FLAGS_safety, 0.1, 1.0);
  CheckRange("groups", FLAGS_groups, 1, 1000000);
  if (FLAGS_tolerance < 1e-14) {
    BadInput(
        Format("--tolerance=%g is below the roundoff of positions, about "
               "1e-15 of a step's displacements",
               FLAGS_tolerance));
  }
  options.step = FLAGS_dt;
  options.first_step = std::min(FLAGS_first_dt, FLAGS_dt);
  options.tolerance = FLAGS_tolerance;
  options.desired_iterations = FLAGS_iterations;
  options.relaxation = FLAGS_relaxation;
  options.safety = FLAGS_safety;
  options.groups = FLAGS_groups;
  if (!ParseSweep(FLAGS_sweep, &options.sweep)) {
    BadInput("--sweep=" + FLAGS_sweep +
             " must be jacobi, gauss_seidel or groups");
  }
  return options;
}

const std::vector<std::string>& StepFlags() {
  static const std::vector<std::string> names = {"dt",
                                                 "first_dt",
                                                 "tolerance",
                                                 "iterations",
                                                 "sweep",
                                                 "groups",
                                                 "relaxation",
                                                 "safety"};
  return names;
}

std::vector<gflags::CommandLineFlagInfo> FlagsDefinedIn(
    const std::string& file) {
  std::vector<gflags::CommandLineFlagInfo> all, found;
  gflags::GetAllFlags(&all);
  for (const auto& flag : all) {
    if (flag.filename.find(file) != std::string::npos) found.push_back(flag);
  }
  return found;
}

std::unique_ptr<Stepper> MakeStepper() {
  const StepperOptions options = MakeStepperOptions();
  if (FLAGS_stepper == "implicit") return CreateImplicitStepper(options);
  if (FLAGS_stepper == "verlet") return CreateVerletStepper(options);
  if (FLAGS_stepper != "minimize") {
    BadInput("--stepper=" + FLAGS_stepper +
             " must be implicit, verlet or minimize");
  }
  std::string error;
  std::unique_ptr<Solver> solver = CreateSolver(FLAGS_solver, &error);
  if (solver == nullptr || !SolvesSteps(*solver, &error)) {
    BadInput("--solver: " + error);
  }
  return CreateMinimizingStepper(options, std::move(solver));
}

namespace {

// Centres and radii of a file, shifted so that its cube is around 0, and its
// velocities, unless it has none or others are asked for.
void ReadStart(FlowSceneOptions* options, FlowState* state) {
  Packing packing;
  FrameExtras extras;
  std::string text, error;
  if (!ReadFile(FLAGS_input, &text, &error) ||
      !ParseFrame(text, FLAGS_input, &packing, &extras, &error)) {
    BadInput("--input: " + error);
  }
  const SmallMatrix& edges = packing.box.edges();
  const int n = packing.size();
  if (packing.dimension() != 3) {
    BadInput("--input: " + FLAGS_input + ": discs; a flow is of spheres");
  }
  if (!edges.isApprox(SmallMatrix::Identity(3, 3) * edges(0, 0), 1e-12)) {
    BadInput("--input: " + FLAGS_input + ": the cell is no cube");
  }
  for (const char* flag : {"particles", "length_ratio", "side", "attempts"}) {
    if (IsGiven(flag)) {
      BadInput(std::string("--") + flag +
               " describes a random start and cannot go with --input");
    }
  }
  options->domain.side = edges(0, 0);
  const double half = 0.5 * options->domain.side;
  // A cube that says where it is may have grains outside of it.
  if (extras.origin.size() == 0) packing.Wrap();
  // Velocities as those of a random start of as many.
  FlowStart start;
  start.particles = n;
  start.seed = FLAGS_seed;
  start.attempts = 0;
  ReadVector("mean_velocity", FLAGS_mean_velocity, start.mean);
  ReadVector("perturbation", FLAGS_perturbation, start.perturbation);
  if (!MakeStart(start, &options->grains, state, &error)) BadInput(error);
  const int stride = options->grains.stride();
  const bool has_velocities = extras.velocities.size() > 0 &&
                              !IsGiven("mean_velocity") &&
                              !IsGiven("perturbation");
  for (int i = 0; i < n; ++i) {
    const double b = packing.radii[i];
    options->grains.radius[i] = b;
    options->grains.mass[i] = FLAGS_density * GrainVolume(3, b);
    for (int k = 0; k < 3; ++k) {
      const double corner = extras.origin.size() > 0 ? extras.origin[k] : 0.0;
      state->x[k * stride + i] = packing.positions(k, i) - (corner + half);
      if (has_velocities) {
        state->v[k * stride + i] = extras.velocities(k, i);
      }
    }
  }
}

}  // namespace

bool MakeCase(FlowCase* made, std::string* relaxed, std::string* error) {
  FlowSceneOptions options = MakeSceneOptions();
  FlowCase& flow = *made;
  CheckPositive("density", FLAGS_density);
  if (!FLAGS_input.empty()) {
    ReadStart(&options, &flow.state);
  } else {
    CheckRange("particles", FLAGS_particles, 1, 10000000);
    CheckPositive("length_ratio", FLAGS_length_ratio);
    CheckRange("length_ratio", FLAGS_length_ratio, 0.0, 2.0);
    CheckRange("attempts", FLAGS_attempts, 0, 1e9);
    FlowStart start;
    start.particles = FLAGS_particles;
    start.side = FLAGS_side;
    start.length_ratio = FLAGS_length_ratio;
    start.density = FLAGS_density;
    start.seed = FLAGS_seed;
    start.attempts = FLAGS_attempts;
    start.period = options.domain.period();
    ReadVector("mean_velocity", FLAGS_mean_velocity, start.mean);
    ReadVector("perturbation", FLAGS_perturbation, start.perturbation);
    if (!MakeStart(start, &options.grains, &flow.state, error)) return false;
  }
  flow.scene = FlowScene::Create(options, error);
  if (flow.scene == nullptr) return false;
  if (!FLAGS_relax_overlaps) return true;
  const std::unique_ptr<Solver> solver = CreateSolver(FLAGS_solver, error);
  if (solver == nullptr) BadInput("--solver: " + *error);
  return RelaxOverlaps(
      options.grains, options.domain, *solver, &flow.state, relaxed, error);
}

std::string Frame(const FlowScene& scene, const FlowState& state, int digits) {
  const int n = scene.size(), stride = scene.stride();
  const Domain& domain = scene.options().domain;
  const double side = domain.side;
  const char* const pbc =
      domain.kind == Domain::Kind::NEAREST_IMAGE ? "T T T" : "F F F";
  std::string text = Format(
      "%d\nLattice=\"%.17g 0 0 0 %.17g 0 0 0 %.17g\" "
      "Origin=\"%.17g %.17g %.17g\" "
      "Properties=species:S:1:pos:R:3:radius:R:1:velo:R:3 pbc=\"%s\" "
      "Time=%.17g\n",
      n,
      side,
      side,
      side,
      -0.5 * side,
      -0.5 * side,
      -0.5 * side,
      pbc,
      state.time);
  for (int i = 0; i < n; ++i) {
    const double* const x = state.x.data() + i;
    const double* const v = state.v.data() + i;
    text += Format("A %.*g %.*g %.*g %.*g %.*g %.*g %.*g\n",
                   digits,
                   x[0],
                   digits,
                   x[stride],
                   digits,
                   x[2 * stride],
                   digits,
                   scene.grains().radius[i],
                   digits,
                   v[0],
                   digits,
                   v[stride],
                   digits,
                   v[2 * stride]);
  }
  return text;
}

}  // namespace granopt
