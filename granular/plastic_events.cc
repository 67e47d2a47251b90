#include "granular/plastic_events.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <memory>
#include <utility>

#include "granular/contact_changes.h"
#include "granular/stability.h"
#include "solvers/format.h"

namespace granopt {
namespace {

constexpr double kTolerance = 1e-12;

// A step belongs to the branch if it dissipates at most this part of the step
// that is searched.
constexpr double kRest = 0.1;

struct State {
  double strain = 0.0;
  Relaxation relaxation;
};

// E_a + W - E_b.
double Dissipated(DeformationMode mode, const State& a, const State& b) {
  const int d = a.relaxation.packing.dimension();
  const SmallMatrix strain = StrainIncrement(mode, d, a.strain, b.strain);
  const auto power = [&strain](const Relaxation& r) {
    return -r.packing.box.Volume() *
           r.observables.stress.cwiseProduct(strain).sum();
  };
  return a.relaxation.observables.energy +
         0.5 * (power(a.relaxation) + power(b.relaxation)) -
         b.relaxation.observables.energy;
}

double LowestEigenvalue(const Packing& packing,
                        const ContactEnergyOptions& options,
                        std::string* error) {
  const std::unique_ptr<ContactEnergy> energy =
      ContactEnergy::Create(packing, options, error);
  if (energy == nullptr) return 0.0;
  const std::vector<double> zero(energy->NumParameters(), 0.0);
  return Certify(*energy, zero.data(), StabilityOptions()).lowest_eigenvalue;
}

std::vector<bool> CountingInBoth(const Relaxation& a, const Relaxation& b) {
  std::vector<bool> counts(a.packing.size());
  for (int i = 0; i < a.packing.size(); ++i) {
    counts[i] = !a.observables.is_rattler[i] && !b.observables.is_rattler[i];
  }
  return counts;
}

}  // namespace

Eigen::MatrixXd DisplacementBetween(const Packing& a,
                                    const Packing& b,
                                    const std::vector<bool>& counts) {
  const int d = a.dimension();
  const int n = a.size();
  // In the reduced cell the nearest image is next to the rounded one.
  Eigen::Matrix3i transform;
  const Box box = a.box.Reduced(&transform);
  Eigen::MatrixXd u = Eigen::MatrixXd::Zero(d, n);
  SmallVector mean = SmallVector::Zero(d);
  int counting = 0;
  for (int i = 0; i < n; ++i) {
    SmallVector r(d);
    for (int k = 0; k < d; ++k) {
      r[k] = (b.Position(i, k) - a.Position(i, k)).Value();
    }
    SmallVector images = box.inverse() * r;
    for (int k = 0; k < d; ++k) images[k] = std::round(images[k]);
    // Exactly r where nothing crossed the cell.
    u.col(i) = r - box.edges() * images;
    if (!counts[i]) continue;
    mean += u.col(i);
    ++counting;
  }
  if (counting > 0) u.colwise() -= mean / counting;
  return u;
}

namespace {

// What changes from the last state on the branch to the first beyond it.
void MeasureEvent(DeformationMode mode,
                  const State& low,
                  const State& high,
                  PlasticEvent* event) {
  event->strain_before = low.strain;
  event->strain_after = high.strain;
  event->energy_drop = Dissipated(mode, low, high);
  const Observables& before = low.relaxation.observables;
  const Observables& after = high.relaxation.observables;
  event->stress_drop = ConjugateStress(mode, before.stress) -
                       ConjugateStress(mode, after.stress);
  event->pressure_drop = before.pressure - after.pressure;
  const std::vector<bool> counts =
      CountingInBoth(low.relaxation, high.relaxation);
  Packing moved = low.relaxation.packing;
  DeformTo(mode, low.strain, high.strain, &moved);
  event->displacement =
      DisplacementBetween(moved, high.relaxation.packing, counts);
  Eigen::ArrayXd square =
      event->displacement.colwise().squaredNorm().transpose().array();
  for (int i = 0; i < square.size(); ++i) {
    if (!counts[i]) square[i] = 0.0;
  }
  const double rigid = std::count(counts.begin(), counts.end(), true);
  const double fourth = square.square().sum();
  if (fourth > 0.0) {
    event->participation = square.sum() * square.sum() / (rigid * fourth);
  }
  const ContactChange change =
      Compare(PairsInTouch(low.relaxation.contacts, counts),
              PairsInTouch(high.relaxation.contacts, counts));
  event->contacts_opened = change.opened;
  event->contacts_closed = change.closed;
}

// How well `back` is where the step began.
void MeasureReversal(const Relaxation& first,
                     const Relaxation& back,
                     PlasticEvent* event) {
  const Observables& begin = first.observables;
  event->reversal_energy =
      begin.energy > 0.0
          ? std::abs(back.observables.energy - begin.energy) / begin.energy
          : 0.0;
  const std::vector<bool> rigid_there = CountingInBoth(first, back);
  const Eigen::MatrixXd away =
      DisplacementBetween(first.packing, back.packing, rigid_there);
  for (int i = 0; i < away.cols() && begin.mean_overlap > 0.0; ++i) {
    if (!rigid_there[i]) continue;
    event->reversal_displacement = std::max(
        event->reversal_displacement, away.col(i).norm() / begin.mean_overlap);
  }
}

}  // namespace

bool LocateEvent(const Packing& start,
                 double from,
                 double to,
                 const PlasticEventOptions& options,
                 const Solver& solver,
                 PlasticEvent* event,
                 std::string* error) {
  if (!(options.width > 0.0)) {
    *error = Format("width = %g must be positive", options.width);
    return false;
  }
  *event = PlasticEvent();
  SolveOptions solve = options.solve;
  solve.relative_tolerance = std::min(solve.relative_tolerance, kTolerance);
  const auto relaxed_at = [&](const State& state, double strain, State* next) {
    Packing packing = state.relaxation.packing;
    DeformTo(options.mode, state.strain, strain, &packing);
    next->strain = strain;
    ++event->relaxations;
    if (!Relax(
            packing, options.energy, solver, solve, &next->relaxation, error)) {
      return false;
    }
    event->unconverged += next->relaxation.summary.Succeeded() ? 0 : 1;
    return true;
  };
  const auto note = [&](const State& state) {
    const Observables& o = state.relaxation.observables;
    BranchPoint point;
    point.strain = state.strain;
    point.energy = o.energy;
    point.stress = ConjugateStress(options.mode, o.stress);
    if (options.follow_mode) {
      point.lowest_eigenvalue =
          LowestEigenvalue(state.relaxation.packing, options.energy, error);
    }
    event->branch.push_back(point);
  };

  State low;
  low.strain = from;
  if (!Relax(start, options.energy, solver, solve, &low.relaxation, error)) {
    return false;
  }
  const State first = low;
  note(low);
  State high;
  if (!relaxed_at(low, to, &high)) return false;
  const double whole = Dissipated(options.mode, low, high);
  const double least = kRest * whole;
  const auto on_branch = [&](const State& next) {
    return !(Dissipated(options.mode, low, next) > least);
  };
  if (!(whole > 0.0)) return true;
  while (std::abs(high.strain - low.strain) > options.width) {
    const double middle = 0.5 * (low.strain + high.strain);
    if (middle == low.strain || middle == high.strain) break;
    State next;
    if (!relaxed_at(low, middle, &next)) return false;
    if (on_branch(next)) {
      low = std::move(next);
      note(low);
    } else {
      high = std::move(next);
    }
  }
  // The state beyond may have been reached from further away.
  const double beyond = high.strain;
  if (!relaxed_at(low, beyond, &high)) return false;
  event->found = !on_branch(high);
  MeasureEvent(options.mode, low, high, event);
  State back;
  if (!relaxed_at(low, from, &back)) return false;
  MeasureReversal(first.relaxation, back.relaxation, event);
  event->before = std::move(low.relaxation);
  event->after = std::move(high.relaxation);
  return true;
}

std::vector<double> RadialHarmonics(const Packing& packing,
                                    const Eigen::MatrixXd& displacement,
                                    int centre,
                                    double inner,
                                    double outer,
                                    int size) {
  Eigen::Matrix3i transform;
  const Box box = packing.box.Reduced(&transform);
  std::vector<std::complex<double>> sum(size, 0.0);
  int count = 0;
  for (int i = 0; i < packing.size(); ++i) {
    SmallVector r = packing.positions.col(i) - packing.positions.col(centre);
    SmallVector images = box.inverse() * r;
    for (int k = 0; k < r.size(); ++k) images[k] = std::round(images[k]);
    r -= box.edges() * images;
    const double distance = r.norm();
    if (distance < inner || distance > outer || !(distance > 0.0)) continue;
    const double radial = displacement.col(i).dot(r) / distance;
    const double theta = std::atan2(r[1], r[0]);
    for (int m = 0; m < size; ++m) sum[m] += std::polar(radial, m * theta);
    ++count;
  }
  std::vector<double> amplitude(size, 0.0);
  for (int m = 0; m < size && count > 0; ++m) {
    amplitude[m] = std::abs(sum[m]) / count;
  }
  return amplitude;
}

bool EnergyAlong(const PlasticEvent& event,
                 const PlasticEventOptions& options,
                 int points,
                 std::vector<double>* values,
                 std::string* error) {
  Packing packing = event.before.packing;
  DeformTo(options.mode, event.strain_before, event.strain_after, &packing);
  const std::unique_ptr<ContactEnergy> energy =
      ContactEnergy::Create(packing, options.energy, error);
  if (energy == nullptr) return false;
  values->resize(points);
  std::vector<double> u(energy->NumParameters());
  for (int p = 0; p < points; ++p) {
    const double t = points > 1 ? static_cast<double>(p) / (points - 1) : 0.0;
    for (int v = 0; v < energy->NumParameters(); ++v) {
      u[v] = t * event.displacement.data()[v];
    }
    if (!energy->EvaluateWithScales(
            u.data(), &(*values)[p], nullptr, nullptr)) {
      *error = "the energy is not defined on the way";
      return false;
    }
  }
  return true;
}

}  // namespace granopt
