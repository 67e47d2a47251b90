#include "granular/cell_energy.h"

#include <cmath>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "Eigen/LU"
#include "gtest/gtest.h"
#include "tests/granular/test_packings.h"

namespace granopt {
namespace {

std::unique_ptr<CellEnergy> MakeCell(const Packing& packing,
                                     const CellEnergyOptions& options) {
  std::string error;
  std::unique_ptr<CellEnergy> cell =
      CellEnergy::Create(packing, options, &error);
  if (cell == nullptr) throw std::runtime_error(error);
  return cell;
}

CellEnergyOptions Loaded(int d, double alpha) {
  CellEnergyOptions options;
  options.energy.alpha = alpha;
  options.pressure = 2e-3;
  options.load = SmallMatrix::Zero(d, d);
  options.load(0, 1) = options.load(1, 0) = 3e-4;
  options.load(0, 0) = 1e-4;
  options.strains = AllStrains(d);
  return options;
}

// A point of the function well away from its origin, and not at a kink.
std::vector<double> PointOf(const CellEnergy& cell, double strain) {
  std::vector<double> x =
      RandomVector(cell.NumParameters() - cell.num_strains(), 2e-3, 5);
  for (int m = 0; m < cell.num_strains(); ++m) {
    x.push_back(strain * (m % 2 == 0 ? 1.0 : -0.7) * cell.strain_length() /
                (1.0 + 0.3 * m));
  }
  return x;
}

// E at fixed cell is ContactEnergy's, to the last bits.
TEST(CellEnergy, IsTheContactEnergyOfTheDeformedPacking) {
  for (const int d : {2, 3}) {
    for (const double alpha : {2.0, 2.5, 3.0}) {
      const Packing packing = RandomPacking(d, 64, d == 2 ? 0.95 : 0.8, 3);
      CellEnergyOptions options = Loaded(d, alpha);
      options.pressure = 0.0;
      options.load = SmallMatrix();
      const auto cell = MakeCell(packing, options);
      const std::vector<double> x = PointOf(*cell, 0.03);
      double value = 0.0;
      Scales scales;
      ASSERT_TRUE(cell->EvaluateWithScales(x.data(), &value, nullptr, &scales));
      const Packing there = cell->Configuration(x.data());
      const Evaluation direct = Evaluate(*MakeEnergy(there, alpha));
      EXPECT_NEAR(value, direct.energy, 1e-12 * direct.energy);
      EXPECT_NEAR(
          scales.gradient, direct.scales.gradient, 1e-12 * scales.gradient);
      EXPECT_NEAR(scales.length, direct.scales.length, 1e-12 * scales.length);
      EXPECT_NEAR(
          scales.vanishing, direct.scales.vanishing, 1e-11 * scales.vanishing);
      const SmallMatrix f =
          SmallMatrix::Identity(d, d) + cell->Strain(x.data());
      EXPECT_NEAR(
          there.box.Volume(), packing.box.Volume() * f.determinant(), 1e-14);
    }
  }
}

// Gradient and Hessian against finite differences, HessianTimes against the
// matrix, in two and three dimensions.
TEST(CellEnergy, DerivativesAreThoseOfDifferences) {
  for (const int d : {2, 3}) {
    for (const double alpha : {2.0, 2.5}) {
      const Packing packing = RandomPacking(d, 24, d == 2 ? 1.0 : 0.9, 8);
      const auto cell = MakeCell(packing, Loaded(d, alpha));
      const int n = cell->NumParameters();
      const std::vector<double> x = PointOf(*cell, 0.01);
      std::vector<double> gradient(n);
      double value = 0.0;
      Scales scales;
      ASSERT_TRUE(
          cell->EvaluateWithScales(x.data(), &value, gradient.data(), &scales));
      SparseMatrix lower;
      ASSERT_TRUE(cell->EvaluateHessian(x.data(), &lower));
      Eigen::MatrixXd hessian(lower);
      hessian.triangularView<Eigen::StrictlyUpper>() = hessian.transpose();
      const double h = 1e-7;
      double worst = 0.0, worst_second = 0.0;
      for (int v = 0; v < n; ++v) {
        const auto along = [&](double t) {
          std::vector<double> y = x;
          y[v] += t;
          double e = 0.0;
          EXPECT_TRUE(cell->EvaluateWithScales(y.data(), &e, nullptr, nullptr));
          return e;
        };
        worst =
            std::max(worst, std::abs(Derivative(along, 1e-5) - gradient[v]));
        std::vector<double> plus = x, minus = x, gp(n), gm(n);
        plus[v] += h;
        minus[v] -= h;
        double e = 0.0;
        ASSERT_TRUE(
            cell->EvaluateWithScales(plus.data(), &e, gp.data(), nullptr));
        ASSERT_TRUE(
            cell->EvaluateWithScales(minus.data(), &e, gm.data(), nullptr));
        for (int w = 0; w < n; ++w) {
          worst_second =
              std::max(worst_second,
                       std::abs((gp[w] - gm[w]) / (2.0 * h) - hessian(w, v)));
        }
      }
      // A kink of a contact that opens may lie in a difference: of alpha = 2
      // the energy still has a continuous second derivative but at those.
      EXPECT_LE(worst, 1e-7 * scales.gradient) << d << " " << alpha;
      const double stiffness = hessian.cwiseAbs().maxCoeff();
      EXPECT_LE(worst_second, 1e-6 * stiffness) << d << " " << alpha;

      const std::vector<double> v = RandomVector(n, 1.0, 11);
      std::vector<double> hv(n);
      ASSERT_TRUE(cell->HessianTimes(x.data(), v.data(), hv.data()));
      const Eigen::VectorXd expected =
          hessian * Eigen::Map<const Eigen::VectorXd>(v.data(), n);
      for (int k = 0; k < n; ++k) {
        EXPECT_NEAR(hv[k], expected[k], 1e-12 * stiffness);
      }
    }
  }
}

// Pattern and sparsity: one block a near pair, and full rows for the strains
// only.
TEST(CellEnergy, TheHessianIsSparse) {
  const Packing packing = ReadData("n256_phi0.8438_a2_relaxed.xyz");
  CellEnergyOptions options;
  options.strains = AllStrains(2);
  const auto cell = MakeCell(packing, options);
  const std::vector<double> x(cell->NumParameters(), 0.0);
  SparseMatrix hessian;
  ASSERT_TRUE(cell->EvaluateHessian(x.data(), &hessian));
  const auto version = cell->PatternVersion();
  EXPECT_LT(hessian.nonZeros(), 3 * 256 + 4 * 3 * 256 + 3 * 512 + 6);
  ASSERT_TRUE(cell->EvaluateHessian(x.data(), &hessian));
  EXPECT_EQ(cell->PatternVersion(), version);
}

// Forces at x in quadruple precision: F^T times those of the deformed packing.
std::vector<double> QuadGradient(const Packing& packing,
                                 const std::vector<Contact>& near,
                                 const SmallMatrix& eps,
                                 const std::vector<double>& x) {
  const int d = packing.dimension();
  std::vector<Quad> gradient(d * packing.size(), 0);
  for (const Contact& contact : near) {
    const auto& id = contact.id;
    Quad before[3], r[3], square = 0;
    for (int k = 0; k < d; ++k) {
      const DoubleDouble xi = packing.Position(id.i, k);
      const DoubleDouble xj = packing.Position(id.j, k);
      before[k] = Quad(xi.hi) + xi.lo - xj.hi - xj.lo + x[d * id.i + k] -
                  x[d * id.j + k];
      for (int c = 0; c < d; ++c) {
        before[k] += Quad(packing.box.edges()(k, c)) * id.image[c];
      }
    }
    for (int k = 0; k < d; ++k) {
      r[k] = before[k];
      for (int c = 0; c < d; ++c) r[k] += Quad(eps(k, c)) * before[c];
      square += r[k] * r[k];
    }
    Quad distance = std::sqrt(static_cast<double>(square));
    for (int n = 0; n < 3; ++n) distance = (distance + square / distance) / 2;
    const Quad overlap =
        Quad(packing.radii[id.i]) + packing.radii[id.j] - distance;
    if (!(overlap > 0)) continue;
    for (int c = 0; c < d; ++c) {
      Quad pull = r[c];
      for (int k = 0; k < d; ++k) pull += Quad(eps(k, c)) * r[k];
      pull *= overlap / distance;
      gradient[d * id.i + c] -= pull;
      gradient[d * id.j + c] += pull;
    }
  }
  std::vector<double> rounded;
  for (const Quad& g : gradient) rounded.push_back(static_cast<double>(g));
  return rounded;
}

// Forces keep their digits next to jamming, under strains of the order of the
// overlaps too: from the reference at the origin and from one at the point.
TEST(CellEnergy, StrainsKeepTheirDigitsNextToJamming) {
  const Packing packing = ReadData("n1024_a2_p1e-08.xyz");
  CellEnergyOptions options;
  options.strains = AllStrains(2);
  const auto cell = MakeCell(packing, options);
  const int n = cell->NumParameters();
  std::vector<double> x = RandomVector(n, 3e-10, 3);
  for (int m = n - 3; m < n; ++m) x[m] = 1e-8 * cell->strain_length();
  std::vector<double> gradient(n);
  double value = 0.0;
  Scales scales;
  // Every pair that could touch there.
  Packing grown = packing;
  grown.ScaleRadii(1.001);
  const auto energy = MakeEnergy(grown, 2.0);
  const std::vector<double> zero(energy->NumParameters(), 0.0);
  const std::vector<double> exact = QuadGradient(
      packing, energy->Contacts(zero.data()), cell->Strain(x.data()), x);
  ASSERT_TRUE(
      cell->EvaluateWithScales(x.data(), &value, gradient.data(), &scales));
  gradient.resize(exact.size());
  EXPECT_LE(MaxDifference(gradient, exact), 2e-14 * scales.gradient);
  EXPECT_GT(MaxAbs(exact), 1e-2 * scales.gradient);
  // Further away, and recentered there.
  for (double& v : x) v *= 1e3;
  const std::vector<double> exact_far = QuadGradient(
      packing, energy->Contacts(zero.data()), cell->Strain(x.data()), x);
  gradient.resize(n);
  ASSERT_TRUE(
      cell->EvaluateWithScales(x.data(), &value, gradient.data(), &scales));
  cell->Recenter(x.data());
  ASSERT_TRUE(
      cell->EvaluateWithScales(x.data(), &value, gradient.data(), &scales));
  gradient.resize(exact_far.size());
  EXPECT_LE(MaxDifference(gradient, exact_far), 2e-14 * scales.gradient);
}

// A list that is rebuilt on the way changes nothing.
TEST(CellEnergy, LargeStrainsRebuildTheList) {
  const Packing packing = RandomPacking(2, 100, 0.9, 4);
  CellEnergyOptions options;
  options.strains = AllStrains(2);
  const auto cell = MakeCell(packing, options);
  std::vector<double> x(cell->NumParameters(), 0.0);
  for (const double strain : {0.001, 0.01, 0.1, -0.2, 0.3}) {
    x[200] = 0.2 * strain * cell->strain_length();
    x[201] = strain * cell->strain_length();
    x[202] = -strain * cell->strain_length();
    double value = 0.0;
    ASSERT_TRUE(cell->EvaluateWithScales(x.data(), &value, nullptr, nullptr));
    const double direct =
        Evaluate(*MakeEnergy(cell->Configuration(x.data()), 2.0)).energy;
    EXPECT_NEAR(value, direct, 1e-11 * direct) << strain;
  }
  double value = 0.0;
  x[201] = 5.0 * cell->strain_length();
  EXPECT_FALSE(cell->EvaluateWithScales(x.data(), &value, nullptr, nullptr));
  x[201] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(cell->EvaluateWithScales(x.data(), &value, nullptr, nullptr));
}

// Enthalpies of 2^a times the stiffness and loads have 2^a times the values.
TEST(CellEnergy, UnitsOfEnergyAreFree) {
  const Packing packing = RandomPacking(2, 50, 0.9, 9);
  CellEnergyOptions options = Loaded(2, 2.0);
  const auto one = MakeCell(packing, options);
  options.energy.stiffness = 8.0;
  options.pressure *= 8.0;
  options.load *= 8.0;
  const auto eight = MakeCell(packing, options);
  const std::vector<double> x = PointOf(*one, 0.01);
  const int n = one->NumParameters();
  std::vector<double> a(n), b(n);
  double ea = 0.0, eb = 0.0;
  ASSERT_TRUE(one->EvaluateWithScales(x.data(), &ea, a.data(), nullptr));
  ASSERT_TRUE(eight->EvaluateWithScales(x.data(), &eb, b.data(), nullptr));
  EXPECT_EQ(8.0 * ea, eb);
  for (int v = 0; v < n; ++v) EXPECT_EQ(8.0 * a[v], b[v]);
}

TEST(CellEnergy, RefusesBadOptions) {
  std::string error;
  const Packing packing = RandomPacking(2, 8, 0.5, 1);
  CellEnergyOptions options;
  options.strains = AllStrains(3);
  EXPECT_EQ(CellEnergy::Create(packing, options, &error), nullptr);
  EXPECT_NE(error.find("2 x 2"), std::string::npos);
  options.strains = AllStrains(2);
  options.pressure = std::nan("");
  EXPECT_EQ(CellEnergy::Create(packing, options, &error), nullptr);
  EXPECT_NE(error.find("pressure = nan"), std::string::npos);
  options.pressure = 0.0;
  options.load = SmallMatrix::Zero(3, 3);
  EXPECT_EQ(CellEnergy::Create(packing, options, &error), nullptr);
}

}  // namespace
}  // namespace granopt
