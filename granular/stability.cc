#include "granular/stability.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <numeric>

#include "granular/force_network.h"
#include "granular/observables.h"
#include "solvers/format.h"
#include "solvers/lowest_modes.h"
#include "solvers/sparse_cholesky.h"

namespace granopt {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// Error of an entry of the gradient, in mean forces.
constexpr double kGradientError = 16.0 * std::numeric_limits<double>::epsilon();

// R / nu. Any number above 4 does.
constexpr double kRegion = 4.0 * (1.0 + 1e-9);

// Kept positive for the rounding of H_- and of its factor, in kappa.
constexpr double kRoundoff = 1e-13;

// Separations that may change by more than this part of the least one are
// beyond what the bounds are made for.
constexpr double kLargestMotion = 1e-2;

// Up to so many mean forces of max|g| a point without a proof counts as
// stationary.
constexpr double kStationary = 1e-6;

// What is known of any point of B, see the header.
struct Region {
  double radius = 0.0;     // R
  double lambda = 0.0;     // lowest eigenvalue of H
  double prestress = 0.0;  // bound of |H_p|
  double alpha = 2.0;
};

// 2 H_- - H, link by link; false if separations may change too much for that.
bool LowerBounds(const ForceNetwork& network,
                 const Region& region,
                 std::vector<LinkBlock>* bounds,
                 int* undecided) {
  const double motion = std::sqrt(2.0 / region.lambda) * region.radius;
  const double along =
      std::sqrt(1.0 + region.prestress / region.lambda) * region.radius;
  *undecided = 0;
  bounds->assign(network.links.size(), LinkBlock());
  for (std::size_t l = 0; l < network.links.size(); ++l) {
    const Link& link = network.links[l];
    if (link.i == link.j) continue;
    if (!(motion < kLargestMotion * link.distance)) return false;
    LinkBlock lower;
    if (link.overlap > 0.0) {
      const double closer =
          link.stiffness > 0.0
              ? std::min(motion, along / std::sqrt(link.stiffness))
              : motion;
      const double shortest = link.distance - closer;
      // The second term is the way that a sideways motion lengthens.
      const double farther = closer + motion * motion / (2.0 * shortest);
      const double least = 1.0 - farther / link.overlap;  // overlap, relative
      const double most = 1.0 + closer / link.overlap;
      if (!(least > 0.0)) ++*undecided;
      double q = 0.0;  // of n (x) n in the Hessian, stiffness + force / length
      if (least > 0.0) {
        q = link.stiffness * std::pow(least, region.alpha - 2.0) +
            link.force * std::pow(least, region.alpha - 1.0) /
                (link.distance + farther);
      }
      // |n' (x) n' - n (x) n| is the sine of the angle between n' and n.
      lower.a = q;
      lower.b = -(q * motion / shortest +
                  link.force * std::pow(most, region.alpha - 1.0) / shortest);
    } else if (motion > -link.overlap) {
      ++*undecided;
      lower.b = -link.stiffness *
                std::pow(motion + link.overlap, region.alpha - 1.0) /
                (link.distance - motion);
    }
    const LinkBlock now = BlockOf(link);
    (*bounds)[l] = {2.0 * lower.a - now.a, 2.0 * lower.b - now.b};
  }
  return true;
}

std::string Grains(const std::vector<int>& grains) {
  constexpr std::size_t kNamed = 5;
  if (grains.size() > kNamed) {
    return Format("%d grains", static_cast<int>(grains.size()));
  }
  std::string list = grains.size() == 1 ? "grain" : "grains";
  for (std::size_t k = 0; k < grains.size(); ++k) {
    list += (k == 0 ? " " : ", ") + std::to_string(grains[k]);
  }
  return list;
}

std::string ModeLine(const Certificate& c) {
  const NormalMode& mode = c.modes[0];
  return Format(
             "lowest eigenvalue %.1e of the mean stiffness, participation "
             "%.2g, half of it on ",
             c.lowest_eigenvalue,
             mode.participation) +
         Grains(mode.carriers);
}

NormalMode MakeMode(const ForceNetwork& network,
                    const VectorXd& vector,
                    int num_grains) {
  const int d = network.dimension;
  const int n = network.size();
  NormalMode mode;
  mode.displacement.setZero(d, num_grains);
  VectorXd weight(n);
  for (int i = 0; i < n; ++i) {
    weight[i] = vector.segment(d * i, d).squaredNorm();
    mode.displacement.col(network.grains[i]) = vector.segment(d * i, d);
  }
  const double sum = weight.sum();
  mode.participation = sum * sum / (n * weight.squaredNorm());
  std::vector<int> order(n);
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(), [&](int a, int b) {
    return weight[a] > weight[b];
  });
  double carried = 0.0;
  // Rounding must not ask for one more of grains that are alike.
  for (int k = 0; k < n && carried < (0.5 - 1e-9) * sum; ++k) {
    carried += weight[order[k]];
    mode.carriers.push_back(network.grains[order[k]]);
  }
  return mode;
}

// Adds the pairs of grains that count and nearly touch. Fills in what the
// certificate says of the network.
void AddGaps(const ContactEnergy& energy,
             const double* u,
             ForceNetwork* network,
             Certificate* certificate) {
  certificate->contacts = static_cast<int>(network->links.size());
  certificate->grains = network->size();
  if (certificate->contacts == 0) return;
  const double overlap = network->mean_overlap / network->length_unit;
  certificate->other_force = network->other_force;
  certificate->mean_overlap = overlap;
  certificate->stiffness = network->stiffness / network->stiffness_unit;
  certificate->smallest_overlap =
      network->smallest_overlap / network->mean_overlap;

  certificate->smallest_gap = kInfinity;
  Gaps gaps;
  const Packing at = energy.Configuration(u);
  if (energy.EvaluateGaps(u, &gaps)) {
    // k delta^(alpha-1) is a force: k in those units.
    const double unit = network->stiffness_unit * network->length_unit /
                        std::pow(network->length_unit, energy.Exponent() - 1.0);
    for (std::size_t g = 0; g < gaps.ids.size(); ++g) {
      const GapId& id = gaps.ids[g];
      if (!network->BothCount(id) || gaps.delta[g] > 0.0) continue;
      Link link;
      link.i = network->place[id.i];
      link.j = network->place[id.j];
      link.normal = SmallVector::Zero(network->dimension);
      link.overlap = network->length_unit * gaps.delta[g];
      link.distance = network->length_unit *
                      (at.radii[id.i] + at.radii[id.j] - gaps.delta[g]);
      link.stiffness = unit * gaps.stiffness[g];
      network->links.push_back(link);
      certificate->smallest_gap =
          std::min(certificate->smallest_gap, -gaps.delta[g] / overlap);
    }
  }
}

// The gradient of E' and a bound of |H_p|: twice the largest sum of f / l of a
// grain.
struct Forces {
  VectorXd gradient;
  double prestress = 0.0;
};

Forces ForcesOf(const ForceNetwork& network) {
  const int d = network.dimension;
  Forces forces;
  forces.gradient = VectorXd::Zero(d * network.size());
  VectorXd tension = VectorXd::Zero(network.size());
  for (const Link& link : network.links) {
    if (!(link.overlap > 0.0) || link.i == link.j) continue;
    forces.gradient.segment(d * link.i, d) -= link.force * link.normal;
    forces.gradient.segment(d * link.j, d) += link.force * link.normal;
    tension[link.i] += link.force / link.distance;
    tension[link.j] += link.force / link.distance;
  }
  forces.prestress = 2.0 * tension.maxCoeff();
  return forces;
}

// Pieces that do not touch, as a message.
std::string PiecesLine(const std::vector<int>& pieces) {
  std::string sizes;
  for (std::size_t k = 0; k < std::min<std::size_t>(3, pieces.size()); ++k) {
    sizes += (k == 0 ? "" : ", ") + std::to_string(pieces[k]);
  }
  if (pieces.size() > 3) sizes += ", ...";
  return Format(
      "%d pieces (%s grains) that do not touch each other and may each "
      "translate",
      static_cast<int>(pieces.size()),
      sizes.c_str());
}

// The lowest modes of H.
LowestModes FindModes(const ForceNetwork& network,
                      const std::vector<LinkBlock>& blocks,
                      int count,
                      int num_grains,
                      Certificate* certificate) {
  const int d = network.dimension;
  LowestModesOptions lowest;
  lowest.count = std::max(1, count);
  lowest.left_out.setZero(d * network.size(), d);
  for (int i = 0; i < network.size(); ++i) {
    lowest.left_out.middleRows(d * i, d).setIdentity();
  }
  LowestModes modes =
      ComputeLowestModes(AssembleBlocks(network, blocks, -1), lowest);
  for (Index k = 0; k < modes.values.size(); ++k) {
    NormalMode mode = MakeMode(network, modes.vectors.col(k), num_grains);
    mode.eigenvalue = modes.values[k] / network.stiffness_unit;
    mode.residual = modes.residuals[k] / network.stiffness_unit;
    certificate->modes.push_back(std::move(mode));
  }
  if (modes.converged) {
    certificate->lowest_eigenvalue = modes.values[0] / network.stiffness;
  }
  return modes;
}

// nu, and the largest change of a separation, of Newton's step with the factor
// of a matrix that is lower by tau kappa: both are slightly too large.
struct NewtonLength {
  double nu = 0.0;
  double largest = 0.0;
};

NewtonLength LengthOfNewtonsStep(const ForceNetwork& network,
                                 const VectorXd& gradient,
                                 SparseCholesky* cholesky) {
  const int d = network.dimension;
  const int before = d * network.held;
  const auto after = gradient.size() - before - d;
  VectorXd right(gradient.size() - d);
  right << gradient.head(before), gradient.tail(after);
  VectorXd step(right.size());
  cholesky->Solve(right.data(), step.data());
  NewtonLength length;
  length.nu = std::sqrt(std::max(0.0, right.dot(step)));
  VectorXd all = VectorXd::Zero(gradient.size());
  all.head(before) = step.head(before);
  all.tail(after) = step.tail(after);
  for (const Link& link : network.links) {
    if (!(link.overlap > 0.0)) continue;
    length.largest = std::max(
        length.largest,
        (all.segment(d * link.i, d) - all.segment(d * link.j, d)).norm());
  }
  return length;
}

}  // namespace

const char* StabilityVerdictName(StabilityVerdict verdict) {
  switch (verdict) {
    case StabilityVerdict::STRICT_MINIMUM:
      return "strict minimum";
    case StabilityVerdict::SADDLE:
      return "stationary, not a minimum";
    case StabilityVerdict::NOT_CERTIFIED:
      return "stationary, not certified";
    case StabilityVerdict::NOT_STATIONARY:
      return "not stationary";
    case StabilityVerdict::DISCONNECTED:
      return "not certified, disconnected";
    case StabilityVerdict::UNJAMMED:
      return "unjammed";
    case StabilityVerdict::FAILED:
      break;
  }
  return "not certified";
}

Certificate Certify(const ContactEnergy& original,
                    const double* u,
                    const StabilityOptions& options) {
  Certificate certificate;
  const auto conclude = [&certificate](StabilityVerdict verdict,
                                       const std::string& message) {
    certificate.verdict = verdict;
    certificate.message = message;
    return certificate;
  };
  for (int v = 0; v < original.NumParameters(); ++v) {
    if (!std::isfinite(u[v])) {
      return conclude(StabilityVerdict::FAILED, "displacements are not finite");
    }
  }
  // A list of its own: it holds every gap up to its skin.
  std::string error;
  const Packing packing = original.Configuration(u);
  ContactEnergyOptions law = original.options();
  law.precision = Precision::DOUBLE;
  const std::unique_ptr<ContactEnergy> energy =
      ContactEnergy::Create(packing, law, &error);
  if (energy == nullptr) return conclude(StabilityVerdict::FAILED, error);
  const std::vector<double> zero(energy->NumParameters(), 0.0);
  double value = 0.0;
  Scales scales;
  energy->EvaluateWithScales(zero.data(), &value, nullptr, &scales);
  const std::vector<Contact> contacts = energy->Contacts(zero.data());
  const Observables observables = Measure(packing, contacts, value);
  ForceNetwork network = MakeForceNetwork(
      packing.dimension(), energy->Exponent(), observables, contacts);
  AddGaps(*energy, zero.data(), &network, &certificate);
  if (contacts.empty()) {
    return conclude(StabilityVerdict::UNJAMMED, "no grain touches another");
  }
  if (scales.vanishing <= options.vanishing_tolerance) {
    return conclude(StabilityVerdict::UNJAMMED,
                    Format("overlaps of %.1e mean radii count as zero",
                           observables.mean_overlap / packing.MeanRadius()));
  }
  if (certificate.contacts == 0) {
    certificate.residual = observables.relative_residual;
    return conclude(StabilityVerdict::NOT_STATIONARY,
                    Format("residual %.1e mean forces, and no rigid grains",
                           observables.relative_residual));
  }

  const Forces forces = ForcesOf(network);
  certificate.residual =
      forces.gradient.lpNorm<Eigen::Infinity>() / network.mean_force;
  const bool stationary = certificate.residual <= kStationary;
  const std::string residual_line =
      Format("residual %.1e mean forces", certificate.residual);

  const std::vector<int> pieces = Pieces(network);
  certificate.pieces = static_cast<int>(pieces.size());
  if (pieces.size() > 1) {
    return stationary
               ? conclude(StabilityVerdict::DISCONNECTED, PiecesLine(pieces))
               : conclude(StabilityVerdict::NOT_STATIONARY, residual_line);
  }
  if (network.size() == 1) {
    certificate.lowest_eigenvalue = kInfinity;
    return conclude(StabilityVerdict::STRICT_MINIMUM,
                    "one grain, which can only translate");
  }

  std::vector<LinkBlock> blocks;
  blocks.reserve(network.links.size());
  for (const Link& link : network.links) blocks.push_back(BlockOf(link));
  // Whatever the verdict.
  const LowestModes modes = FindModes(
      network, blocks, options.modes, observables.grains, &certificate);
  if (!modes.converged) {
    return conclude(StabilityVerdict::FAILED,
                    "lowest modes not found: " + modes.message);
  }

  // (1)
  const double floor = options.zero * network.stiffness;
  SparseCholesky cholesky;
  if (!cholesky.Factorize(
          AssembleBlocks(network, blocks, network.held), 1, -floor)) {
    if (!stationary) {
      return conclude(StabilityVerdict::NOT_STATIONARY,
                      residual_line + "; " + ModeLine(certificate));
    }
    return conclude(certificate.lowest_eigenvalue < -options.zero
                        ? StabilityVerdict::SADDLE
                        : StabilityVerdict::NOT_CERTIFIED,
                    ModeLine(certificate));
  }
  const NewtonLength newton =
      LengthOfNewtonsStep(network, forces.gradient, &cholesky);
  certificate.newton_step = newton.largest / network.mean_overlap;

  // (2)
  Region region;
  region.alpha = energy->Exponent();
  region.lambda = std::max(floor, modes.values[0] - modes.residuals[0]);
  region.prestress = forces.prestress;
  region.radius =
      kRegion *
      (newton.nu + kGradientError * network.mean_force *
                       std::sqrt(static_cast<double>(forces.gradient.size()) /
                                 region.lambda));
  std::vector<LinkBlock> bounds;
  const double motion = std::sqrt(2.0 / region.lambda) * region.radius;
  const bool bounded =
      motion < 0.99 * network.length_unit * energy->skin() &&
      LowerBounds(network, region, &bounds, &certificate.undecided_pairs);
  // (3)
  if (!bounded ||
      !cholesky.Factorize(AssembleBlocks(network, bounds, network.held),
                          2,
                          -kRoundoff * network.stiffness)) {
    certificate.undecided_pairs = 0;
    return conclude(
        stationary ? StabilityVerdict::NOT_CERTIFIED
                   : StabilityVerdict::NOT_STATIONARY,
        residual_line +
            Format(" is too large for a proof with a lowest eigenvalue %.1e of "
                   "the mean stiffness",
                   certificate.lowest_eigenvalue));
  }
  certificate.distance =
      region.radius / std::sqrt(region.lambda) / network.mean_overlap;
  // The least value of g.x + x.H x / 4 is -nu^2.
  const double unit =
      network.stiffness_unit * network.length_unit * network.length_unit;
  const double bound = region.radius / kRegion;
  certificate.excess_energy = bound * bound / (unit * value);
  std::string message = Format(
      "lowest eigenvalue %.1e of the mean stiffness, the minimum is "
      "within %.1e mean overlaps",
      certificate.lowest_eigenvalue,
      certificate.distance);
  if (certificate.undecided_pairs > 0) {
    message += Format(", %d contact%s may open or close on the way",
                      certificate.undecided_pairs,
                      certificate.undecided_pairs == 1 ? "" : "s");
  }
  return conclude(StabilityVerdict::STRICT_MINIMUM, message);
}

}  // namespace granopt
