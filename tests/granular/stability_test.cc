#include "granular/stability.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "Eigen/Dense"
#include "granular/observables.h"
#include "granular/relaxation.h"
#include "gtest/gtest.h"
#include "solvers/registry.h"
#include "tests/granular/test_packings.h"

namespace granopt {
namespace {

constexpr double kPi = 3.14159265358979323846;

Certificate CertifyAtRest(const Packing& packing,
                          double alpha,
                          const StabilityOptions& options = {}) {
  const auto energy = MakeEnergy(packing, alpha);
  const std::vector<double> zero(energy->NumParameters(), 0.0);
  return Certify(*energy, zero.data(), options);
}

Packing Relaxed(const Packing& start, double alpha, double tolerance) {
  std::string error;
  const auto solver =
      CreateSolver("lbfgs:preconditioner=hessian,every=5,shift=1e-4", &error);
  EXPECT_NE(solver, nullptr) << error;
  ContactEnergyOptions energy;
  energy.alpha = alpha;
  SolveOptions options;
  options.relative_tolerance = tolerance;
  Relaxation result;
  EXPECT_TRUE(Relax(start, energy, *solver, options, &result, &error)) << error;
  return result.packing;
}

// The rows and columns of the whole Hessian that belong to grains in `grains`.
Eigen::MatrixXd DenseHessian(const Packing& packing,
                             double alpha,
                             const std::vector<bool>& is_left_out) {
  const auto energy = MakeEnergy(packing, alpha);
  const std::vector<double> zero(energy->NumParameters(), 0.0);
  SparseMatrix lower;
  EXPECT_TRUE(energy->EvaluateHessian(zero.data(), &lower));
  const Eigen::MatrixXd all =
      Eigen::MatrixXd(lower).selfadjointView<Eigen::Lower>();
  std::vector<int> kept;
  for (int v = 0; v < all.rows(); ++v) {
    if (!is_left_out[v / packing.dimension()]) kept.push_back(v);
  }
  return all(kept, kept);
}

Eigen::VectorXd Eigenvalues(const Eigen::MatrixXd& matrix) {
  return Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(matrix,
                                                        Eigen::EigenvaluesOnly)
      .eigenvalues();
}

std::vector<bool> Rattlers(const Packing& packing, double alpha) {
  const auto energy = MakeEnergy(packing, alpha);
  const std::vector<double> zero(energy->NumParameters(), 0.0);
  return Measure(packing, energy->Contacts(zero.data()), 0.0).is_rattler;
}

// n x n discs, each touching four.
Packing SquareLattice(int n, double a, double overlap) {
  return BravaisLattice(Matrix2(a, 0.0, 0.0, a), {n, n}, 0.5 * (a + overlap));
}

// ---- minima

TEST(Stability, RelaxedPackingsAreCertified) {
  for (const char* file : {"n64_jammed.xyz",
                           "n64_3d_jammed.xyz",
                           "n256_phi0.8438_a2_relaxed.xyz",
                           "n256_phi0.8438_a2.5_relaxed.xyz",
                           "n1024_a2_p1e-04.xyz",
                           "n1024_a2_p1e-08.xyz"}) {
    SCOPED_TRACE(file);
    const Packing packing = ReadData(file);
    const double alpha = std::stod(packing.attributes.at("alpha"));
    const Certificate c = CertifyAtRest(packing, alpha);
    EXPECT_EQ(c.verdict, StabilityVerdict::STRICT_MINIMUM) << c.message;
    EXPECT_EQ(c.pieces, 1);
    EXPECT_GT(c.lowest_eigenvalue, 1e-6);
    EXPECT_LT(c.distance, 0.1);
    EXPECT_LT(c.newton_step, c.distance);
    EXPECT_LT(c.newton_step, c.smallest_overlap);
    const auto energy = MakeEnergy(packing, alpha);
    const std::vector<double> zero(energy->NumParameters(), 0.0);
    const Observables o = Measure(packing, energy->Contacts(zero.data()), 0.0);
    EXPECT_EQ(c.grains, o.rigid_grains);
    EXPECT_EQ(c.contacts, o.rigid_contacts);
  }
}

TEST(Stability, ModesAreThoseOfADenseMethod) {
  for (const char* file : {"n64_jammed.xyz",
                           "n64_3d_jammed.xyz",
                           "n256_phi0.8438_a2.5_relaxed.xyz"}) {
    SCOPED_TRACE(file);
    const Packing packing = ReadData(file);
    const double alpha = std::stod(packing.attributes.at("alpha"));
    const int d = packing.dimension();
    StabilityOptions options;
    options.modes = 5;
    const Certificate c = CertifyAtRest(packing, alpha, options);
    const std::vector<bool> rattler = Rattlers(packing, alpha);
    const Eigen::MatrixXd hessian = DenseHessian(packing, alpha, rattler);
    const Eigen::VectorXd oracle = Eigenvalues(hessian);
    ASSERT_EQ(c.modes.size(), 5u);
    for (int k = 0; k < d; ++k)
      EXPECT_NEAR(oracle[k] / c.stiffness, 0.0, 1e-13);
    for (int k = 0; k < 5; ++k) {
      const NormalMode& mode = c.modes[k];
      EXPECT_NEAR(
          mode.eigenvalue / c.stiffness, oracle[d + k] / c.stiffness, 1e-13);
      // H e = lambda e, |e| = 1, no translation, rattlers at rest.
      EXPECT_NEAR(mode.displacement.norm(), 1.0, 1e-12);
      EXPECT_LT(mode.displacement.rowwise().sum().norm(), 1e-11);
      std::vector<double> hv(d * packing.size()), zero(hv.size(), 0.0);
      const auto energy = MakeEnergy(packing, alpha);
      energy->HessianTimes(zero.data(), mode.displacement.data(), hv.data());
      double sum4 = 0.0;
      for (int i = 0; i < packing.size(); ++i) {
        sum4 += std::pow(mode.displacement.col(i).norm(), 4);
        if (rattler[i]) {
          EXPECT_EQ(mode.displacement.col(i).norm(), 0.0);
          continue;
        }
        for (int x = 0; x < d; ++x) {
          EXPECT_NEAR(hv[d * i + x],
                      mode.eigenvalue * mode.displacement(x, i),
                      1e-9 * c.stiffness);
        }
      }
      EXPECT_NEAR(mode.participation, 1.0 / (c.grains * sum4), 1e-12);
      double carried = 0.0;
      for (const int i : mode.carriers) {
        carried += mode.displacement.col(i).squaredNorm();
      }
      EXPECT_GE(carried, 0.5 - 1e-9);
      carried -= mode.displacement.col(mode.carriers.back()).squaredNorm();
      EXPECT_LT(carried, 0.5);
    }
    EXPECT_EQ(c.lowest_eigenvalue, c.modes[0].eigenvalue / c.stiffness);
  }
}

// Holding a grain is as good as removing the translations: as many negative
// eigenvalues, and a lowest one that is not larger.
TEST(Stability, HoldingAGrainRemovesTheTranslationsAndNothingElse) {
  for (const Packing& packing :
       {ReadData("n64_jammed.xyz"),
        ReadData("n64_3d_jammed.xyz"),
        SquareLattice(6, 0.125, 0.01),
        BravaisLattice(HexagonalCell(1.0), {5, 4}, 0.51),
        RandomPacking(2, 60, 2.5, 3)}) {
    const int d = packing.dimension();
    // Relaxed rattlers touch nobody; at phi = 2.5 everyone touches someone.
    std::vector<bool> rattler = Rattlers(packing, 2.0);
    if (packing.size() == 60) rattler.assign(60, false);
    const Eigen::MatrixXd all = DenseHessian(packing, 2.0, rattler);
    const Eigen::VectorXd values = Eigenvalues(all);
    const double zero = 1e-12 * values.cwiseAbs().maxCoeff();
    const int negative = static_cast<int>((values.array() < -zero).count());
    EXPECT_EQ((values.array().abs() <= zero).count(), d);
    const int n = static_cast<int>(all.rows()) / d;
    for (const int held : {0, n / 2, n - 1}) {
      std::vector<int> kept;
      for (int v = 0; v < d * n; ++v) {
        if (v / d != held) kept.push_back(v);
      }
      const Eigen::VectorXd rest = Eigenvalues(all(kept, kept));
      EXPECT_EQ((rest.array() < 0.0).count(), negative);
      if (negative == 0) {
        EXPECT_LE(rest[0], values[d]);
        EXPECT_GE(rest[0] * (1 + n), values[d]);
      }
    }
  }
}

// Whoever is called a strict minimum has one as near and as deep as is said.
TEST(Stability, TheMinimumIsWhereTheCertificateSays) {
  int certified = 0;
  for (const double alpha : {2.0, 2.5}) {
    const Packing start =
        ReadData(alpha == 2.0 ? "n256_phi0.8438_a2_relaxed.xyz"
                              : "n256_phi0.8438_a2.5_relaxed.xyz");
    const Packing minimum = Relaxed(start, alpha, 1e-14);
    const auto energy = MakeEnergy(minimum, alpha);
    const std::vector<bool> rattler = Rattlers(minimum, alpha);
    const double least = Evaluate(*energy).energy;
    const double overlap = CertifyAtRest(minimum, alpha).mean_overlap;
    for (double size = 1e-9; size < 10.0; size *= 10.0) {
      SCOPED_TRACE(size);
      std::vector<double> u =
          RandomVector(energy->NumParameters(), size * overlap, 1);
      for (std::size_t v = 0; v < u.size(); ++v) {
        if (rattler[v / 2]) u[v] = 0.0;
      }
      const Certificate c = Certify(*energy, u.data(), {});
      if (size > 2.0) {
        EXPECT_EQ(c.verdict, StabilityVerdict::NOT_STATIONARY) << c.message;
      }
      if (size < 1e-6) {
        EXPECT_TRUE(c.IsStrictMinimum()) << c.message;
      }
      if (!c.IsStrictMinimum()) continue;
      ++certified;
      // Without its translation, over the grains that count.
      Eigen::Vector2d mean = Eigen::Vector2d::Zero();
      double norm2 = 0.0;
      for (std::size_t v = 0; v < u.size(); ++v) {
        mean[v % 2] += u[v] / c.grains;
        norm2 += u[v] * u[v];
      }
      norm2 -= c.grains * mean.squaredNorm();
      EXPECT_LE(std::sqrt(norm2) / overlap, c.distance);
      EXPECT_GT(100.0 * std::sqrt(norm2) / overlap, 0.1 * size)
          << "a bound of some use";
      const double above = Evaluate(*energy, u).energy - least;
      EXPECT_LE(above, c.excess_energy * (least + above) + 4.0 * kEps * least);
    }
  }
  EXPECT_GE(certified, 8);
}

TEST(Stability, ResidualsTooLargeForAProofAreNotCertified) {
  // Near jamming even 1e-5 mean overlaps are far.
  const Packing packing = ReadData("n1024_a2_p1e-08.xyz");
  const auto energy = MakeEnergy(packing, 2.0);
  const double overlap = CertifyAtRest(packing, 2.0).mean_overlap;
  const std::vector<double> near =
      RandomVector(energy->NumParameters(), 1e-4 * overlap, 2);
  const Certificate c = Certify(*energy, near.data(), {});
  EXPECT_EQ(c.verdict, StabilityVerdict::NOT_STATIONARY) << c.message;
  EXPECT_NE(c.message.find("residual"), std::string::npos);
  EXPECT_EQ(Certify(*MakeEnergy(RandomPacking(2, 100, 0.9, 1), 2.0),
                    std::vector<double>(200, 0.0).data(),
                    {})
                .verdict,
            StabilityVerdict::NOT_STATIONARY);
}

// ---- what is no minimum

// Sheared layers: e_y exp(i q x) has the eigenvalue -2 (f / l) (1 - cos q).
TEST(Stability, ASquareLatticeUnderPressureIsASaddle) {
  const double a = 0.125;
  const double overlap = 0.01;
  for (const double alpha : {2.0, 2.5}) {
    StabilityOptions options;
    options.modes = 4;
    const Certificate c =
        CertifyAtRest(SquareLattice(8, a, overlap), alpha, options);
    EXPECT_EQ(c.verdict, StabilityVerdict::SADDLE) << c.message;
    const double tension = std::pow(overlap, alpha - 1.0) / a;
    // Both polarizations at q = pi, then four at the next q, +-.
    const double next = -2.0 * tension * (1.0 - std::cos(0.75 * kPi));
    EXPECT_NEAR(c.modes[0].eigenvalue, -4.0 * tension, 1e-12 * c.stiffness);
    EXPECT_NEAR(c.modes[1].eigenvalue, -4.0 * tension, 1e-12 * c.stiffness);
    EXPECT_NEAR(c.modes[2].eigenvalue, next, 1e-12 * c.stiffness);
    EXPECT_NEAR(c.modes[3].eigenvalue, next, 1e-12 * c.stiffness);
    EXPECT_NE(c.message.find("lowest eigenvalue -"), std::string::npos)
        << c.message;
    // The energy does fall along the mode.
    const Packing packing = SquareLattice(8, a, overlap);
    const auto energy = MakeEnergy(packing, alpha);
    const Eigen::MatrixXd u = 1e-3 * c.modes[0].displacement;
    const std::vector<double> moved(u.data(), u.data() + u.size());
    EXPECT_LT(Evaluate(*energy, moved).energy, Evaluate(*energy).energy);
  }
  // So little pressure that it counts as zero: flat.
  const Certificate flat = CertifyAtRest(SquareLattice(8, a, 1e-12 * a), 2.0);
  EXPECT_EQ(flat.verdict, StabilityVerdict::NOT_CERTIFIED) << flat.message;
}

// Six contacts hold against each other's pre-stress.
TEST(Stability, AHexagonalLatticeIsAMinimum) {
  const Packing lattice = BravaisLattice(HexagonalCell(1.0), {6, 6}, 0.51);
  const Certificate c = CertifyAtRest(lattice, 2.0);
  EXPECT_EQ(c.verdict, StabilityVerdict::STRICT_MINIMUM) << c.message;
  // With zero called something that it is not, it is no longer one.
  StabilityOptions options;
  options.zero = 2.0 * c.lowest_eigenvalue;
  EXPECT_EQ(CertifyAtRest(lattice, 2.0, options).verdict,
            StabilityVerdict::NOT_CERTIFIED);
}

// Two contacts each, opposite: no rattlers, since they carry the load.
TEST(Stability, SqueezedGrainsCountAndBuckle) {
  for (const int d : {2, 3}) {
    const int n = 4;
    SmallMatrix edges = 10.0 * SmallMatrix::Identity(d, d);
    edges(0, 0) = n;
    Eigen::MatrixXd x = Eigen::MatrixXd::Zero(d, n);
    for (int i = 0; i < n; ++i) x(0, i) = i;
    const Certificate c = CertifyAtRest(
        MakePacking(Box(edges), x, std::vector<double>(n, 0.51)), 2.0);
    EXPECT_EQ(c.verdict, StabilityVerdict::SADDLE) << c.message;
    ASSERT_EQ(c.grains, n);
    // Every other grain to the side: -(f / l) 2 (1 - cos pi).
    EXPECT_NEAR(c.lowest_eigenvalue, -4.0 * 0.02, 1e-13);
    EXPECT_NEAR(c.modes[0].participation, 1.0, 1e-12);
  }
}

TEST(Stability, PiecesThatDoNotTouchAreNotCertified) {
  // Grains that touch their own images, in two rows.
  SmallMatrix edges = SmallMatrix::Identity(2, 2);
  edges(1, 1) = 10.0;
  Eigen::MatrixXd x(2, 2);
  x << 0.1, 0.4, 0.0, 5.0;
  const Certificate c =
      CertifyAtRest(MakePacking(Box(edges), x, {0.51, 0.51}), 2.0);
  EXPECT_EQ(c.verdict, StabilityVerdict::DISCONNECTED) << c.message;
  EXPECT_EQ(c.pieces, 2);
  EXPECT_EQ(c.message,
            "2 pieces (1, 1 grains) that do not touch each other and may each "
            "translate");
  // Nearly in touch is not in touch.
  x(0, 1) = 0.1;
  x(1, 1) = 1.03;
  const Certificate near =
      CertifyAtRest(MakePacking(Box(edges), x, {0.51, 0.51}), 2.0);
  EXPECT_EQ(near.verdict, StabilityVerdict::DISCONNECTED) << near.message;
  EXPECT_NEAR(near.smallest_gap, 0.01 / 0.02, 1e-12);
}

TEST(Stability, ASingleGrainCanOnlyTranslate) {
  const Packing wedged =
      MakePacking(Box::Cube(2, 1.0), Vector2(0.3, 0.4), {0.55});
  const Certificate c = CertifyAtRest(wedged, 2.0);
  EXPECT_EQ(c.verdict, StabilityVerdict::STRICT_MINIMUM);
  EXPECT_EQ(c.lowest_eigenvalue, std::numeric_limits<double>::infinity());
  EXPECT_EQ(c.grains, 1);
  EXPECT_EQ(c.contacts, 2);
  EXPECT_TRUE(c.modes.empty());
  const Certificate alone = CertifyAtRest(
      MakePacking(Box::Cube(2, 1.0), Vector2(0.3, 0.4), {0.2}), 2.0);
  EXPECT_EQ(alone.verdict, StabilityVerdict::UNJAMMED);
}

TEST(Stability, WithoutForcesNothingIsCertified) {
  Packing packing = ReadData("n64_jammed.xyz");
  packing.ScaleRadii(1.0 - 1e-6);
  EXPECT_EQ(CertifyAtRest(packing, 2.0).verdict, StabilityVerdict::UNJAMMED);
  // Just in touch: contacts that carry nothing.
  const Certificate loose =
      CertifyAtRest(BravaisLattice(HexagonalCell(1.0), {4, 4}, 0.5), 2.0);
  EXPECT_EQ(loose.verdict, StabilityVerdict::UNJAMMED) << loose.message;
  StabilityOptions options;
  options.vanishing_tolerance = 0.1;
  const Certificate vanished = CertifyAtRest(
      BravaisLattice(HexagonalCell(1.0), {4, 4}, 0.501), 2.0, options);
  EXPECT_EQ(vanished.verdict, StabilityVerdict::UNJAMMED);
  const auto energy = MakeEnergy(packing, 2.0);
  const std::vector<double> bad(energy->NumParameters(),
                                std::numeric_limits<double>::quiet_NaN());
  EXPECT_EQ(Certify(*energy, bad.data(), {}).verdict, StabilityVerdict::FAILED);
}

// ---- invariance

void ExpectSame(const Certificate& a, const Certificate& b) {
  EXPECT_EQ(a.verdict, b.verdict);
  EXPECT_EQ(a.message, b.message);
  EXPECT_EQ(a.grains, b.grains);
  EXPECT_EQ(a.contacts, b.contacts);
  EXPECT_EQ(a.residual, b.residual);
  EXPECT_EQ(a.lowest_eigenvalue, b.lowest_eigenvalue);
  EXPECT_EQ(a.newton_step, b.newton_step);
  EXPECT_EQ(a.smallest_overlap, b.smallest_overlap);
  EXPECT_EQ(a.smallest_gap, b.smallest_gap);
  EXPECT_EQ(a.distance, b.distance);
  EXPECT_EQ(a.excess_energy, b.excess_energy);
  EXPECT_EQ(a.undecided_pairs, b.undecided_pairs);
}

TEST(Stability, OtherUnitsGiveTheScaledResult) {
  for (const char* file : {"n64_jammed.xyz", "n256_phi0.8438_a2_relaxed.xyz"}) {
    const Packing packing = ReadData(file);
    const Certificate c = CertifyAtRest(packing, 2.0);
    for (const auto& [a, b] : {std::pair(5, 0), {-40, 3}, {7, -21}}) {
      const Packing scaled = WithLengths(b, packing);
      ContactEnergyOptions options;
      options.stiffness = std::ldexp(1.0, a);
      const auto energy = MakeEnergy(scaled, options);
      const std::vector<double> zero(energy->NumParameters(), 0.0);
      const Certificate same = Certify(*energy, zero.data(), {});
      ExpectSame(c, same);
      EXPECT_EQ(same.stiffness, options.stiffness * c.stiffness);
      EXPECT_EQ(same.modes[0].eigenvalue,
                options.stiffness * c.modes[0].eigenvalue);
      EXPECT_EQ(same.modes[0].displacement, c.modes[0].displacement);
    }
  }
}

TEST(Stability, RattlersDoNotMatter) {
  const Packing packing = ReadData("n256_phi0.8438_a2_relaxed.xyz");
  const Certificate c = CertifyAtRest(packing, 2.0);
  // One more, in the widest hole of a grid of points.
  Packing more = packing;
  SmallVector place = Vector2(0.0, 0.0);
  double widest = 0.0;
  for (int k = 0; k < 200 * 200; ++k) {
    const SmallVector x = Vector2((k % 200) / 200.0, (k / 200) / 200.0);
    double room = 1.0;
    for (int i = 0; i < packing.size(); ++i) {
      Eigen::Vector2d apart = packing.positions.col(i) - x;
      for (int m = 0; m < 2; ++m) apart[m] -= std::round(apart[m]);
      room = std::min(room, apart.norm() - packing.radii[i]);
    }
    if (room > widest) {
      widest = room;
      place = x;
    }
  }
  const int n = packing.size();
  ASSERT_EQ(packing.positions_low.size(), 0);
  more.positions.conservativeResize(2, n + 1);
  more.radii.conservativeResize(n + 1);
  more.positions.col(n) = place;
  more.radii[n] = 0.9 * widest;
  more.species.clear();
  Certificate same = CertifyAtRest(more, 2.0);
  EXPECT_EQ(same.modes[0].displacement.leftCols(n), c.modes[0].displacement);
  // Gaps are looked at up to a part of the smallest radius.
  same.smallest_gap = c.smallest_gap;
  ExpectSame(c, same);
  // Resting on one neighbour with a force of the order of the residual.
  more.radii[n] = widest * (1.0 + 1e-12);
  const Certificate resting = CertifyAtRest(more, 2.0);
  EXPECT_EQ(resting.grains, c.grains);
  EXPECT_EQ(resting.lowest_eigenvalue, c.lowest_eigenvalue);
  EXPECT_TRUE(resting.IsStrictMinimum());
}

TEST(Stability, DoesNotDependOnListsOrReference) {
  const Packing packing = ReadData("n256_phi0.8438_a2_relaxed.xyz");
  Packing start = packing;
  start.Perturb(1e-3, 4);
  const auto energy = MakeEnergy(start, 2.0);
  std::vector<double> u(energy->NumParameters());
  for (int i = 0; i < packing.size(); ++i) {
    for (int k = 0; k < 2; ++k) {
      u[2 * i + k] = packing.positions(k, i) - start.positions(k, i);
    }
  }
  const Certificate there = Certify(*energy, u.data(), {});
  EXPECT_TRUE(there.IsStrictMinimum()) << there.message;
  ExpectSame(there, CertifyAtRest(energy->Configuration(u.data()), 2.0));
}

}  // namespace
}  // namespace granopt
