#include "experiments/conditioning_measure.h"

#include <limits>
#include <utility>

#include "experiments/run.h"
#include "granular/force_network.h"

namespace granopt {

State Examine(const Packing& packing, const ContactEnergyOptions& law) {
  State state;
  std::string error;
  state.packing = packing;
  state.energy = ContactEnergy::Create(packing, law, &error);
  if (state.energy == nullptr) BadInput(error);
  const int n = state.energy->NumParameters();
  state.zero.assign(n, 0.0);
  state.gradient.resize(n);
  state.energy->EvaluateWithScales(
      state.zero.data(), &state.cost, state.gradient.data(), &state.scales);
  state.contacts = state.energy->Contacts(state.zero.data());
  state.observables = Measure(packing, state.contacts, state.cost);
  state.counts = CountingGrains(state.observables, state.contacts);
  return state;
}

SparseMatrix HessianAt(const State& state) {
  Eigen::VectorXd gradient;
  SparseMatrix h;
  if (!EvaluateAmong(
          *state.energy, state.zero.data(), state.counts, &gradient, &h)) {
    BadInput("the energy is not defined");
  }
  return h;
}

bool MakeP(const std::string& spec,
           const State& state,
           SparseMatrix* p,
           std::string* why) {
  const int n = state.energy->NumParameters();
  if (spec == kNone) {
    if (!(state.scales.length > 0.0)) {
      *why = "no contact";
      return false;
    }
    p->resize(n, n);
    p->setIdentity();
    *p *= state.scales.gradient / state.scales.length;
    return true;
  }
  const std::unique_ptr<Preconditioner> made = CreatePreconditioner(spec, why);
  if (made == nullptr || !made->Supports(*state.energy, why)) return false;
  Monitor monitor(state.energy.get(), SolveOptions(), spec);
  made->Update(
      {state.zero.data(), state.cost, state.gradient.data(), state.scales},
      nullptr,
      &monitor);
  if (made->num_fallbacks() > 0) {
    *why = "P was not positive definite";
    return false;
  }
  // All registered ones are sparse, and only their products are public.
  std::vector<Eigen::Triplet<double>> entries;
  std::vector<double> unit(n, 0.0), column(n);
  for (int c = 0; c < n; ++c) {
    unit[c] = 1.0;
    made->Multiply(unit.data(), column.data());
    unit[c] = 0.0;
    for (int r = c; r < n; ++r) {
      if (r == c || column[r] != 0.0) entries.emplace_back(r, c, column[r]);
    }
  }
  p->resize(n, n);
  p->setFromTriplets(entries.begin(), entries.end());
  return true;
}

ConditionRow Measured(const SparseMatrix& h,
                      const State& state,
                      const SparseMatrix& p) {
  ConditionRow row;
  const Condition c =
      ComputeCondition(h,
                       p,
                       BlindMotions(state.packing.dimension(), state.counts),
                       ConditionOptions());
  row.found = c.found;
  row.dimensions = c.dimensions;
  row.message = c.message;
  row.number = std::numeric_limits<double>::quiet_NaN();
  if (c.found) {
    row.lowest = c.lowest;
    row.highest = c.highest;
    row.number = c.Number();
    row.negative = c.negative;
    row.below = c.below;
    row.above = c.above;
  }
  return row;
}

ChangeRow MeasuredChange(const State& before,
                         const State& deformed,
                         const State* after,
                         double strain) {
  ChangeRow row;
  const ContactPairs pairs = PairsInTouch(before.contacts, before.counts);
  // Of the same grains: a deformed state need not have a rigid part at all.
  const ContactPairs pairs_deformed =
      PairsInTouch(deformed.contacts, before.counts);
  row.contacts = static_cast<int>(pairs.size());
  row.deformed = Compare(pairs, pairs_deformed);
  row.relaxed = after != nullptr;
  if (after != nullptr) {
    const ContactPairs pairs_after =
        PairsInTouch(after->contacts, after->counts);
    row.relaxation = Compare(pairs_deformed, pairs_after);
    row.step = Compare(pairs, pairs_after);
  }
  // Newton's step moves the grains that counted before: the deformation has
  // opened contacts that relaxation closes again.
  NewtonStep newton;
  WayChanges way;
  if (ComputeNewtonStep(*deformed.energy,
                        deformed.zero.data(),
                        before.counts,
                        &newton,
                        &row.message)) {
    row.newton_shift = newton.relative_shift;
    row.newton_length = newton.length;
    if (ChangesOnTheWay(deformed.packing,
                        newton.displacement.data(),
                        before.counts,
                        &way,
                        &row.message)) {
      row.newton_first = way.first;
      row.newton_opened = way.opened;
      row.newton_closed = way.closed;
    }
  }
  // The deformed cell has its own displacements: the same to first order.
  const int d = before.packing.dimension();
  SmallMatrix gradient = SimpleShear(d, strain);
  gradient -= SmallMatrix::Identity(d, d);
  NewtonStep response;
  std::string ignored;
  if (ComputeLinearResponse(*before.energy,
                            before.zero.data(),
                            before.counts,
                            gradient,
                            &response,
                            &ignored)) {
    const ContactPairs predicted = PairsInTouch(
        deformed.energy->Contacts(response.displacement.data()), before.counts);
    row.predicted = Compare(pairs, predicted);
    if (after != nullptr) {
      row.missed =
          Compare(predicted, PairsInTouch(after->contacts, after->counts));
    }
  }
  return row;
}

}  // namespace granopt
