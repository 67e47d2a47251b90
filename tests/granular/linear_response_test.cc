#include "granular/linear_response.h"

#include <cmath>

#include "granular/relaxation.h"
#include "gtest/gtest.h"
#include "tests/granular/test_packings.h"

namespace granopt {
namespace {

// n x n discs of diameter 1 on a triangular lattice of the given spacing.
Packing Triangular(int n, double spacing) {
  Packing packing;
  SmallMatrix edges(2, 2);
  edges << n, 0.5 * n, 0.0, n * std::sqrt(0.75);
  edges *= spacing;
  packing.box = Box(edges);
  packing.positions.resize(2, n * n);
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j < n; ++j) {
      packing.positions(0, n * i + j) = spacing * (i + 0.5 * j);
      packing.positions(1, n * i + j) = spacing * j * std::sqrt(0.75);
    }
  }
  packing.radii.setConstant(n * n, 0.5);
  return packing;
}

ContactEnergyOptions Law(double alpha) {
  ContactEnergyOptions law;
  law.alpha = alpha;
  return law;
}

Relaxation Relaxed(const Packing& start, double alpha) {
  std::string error;
  const auto solver = CreateSolver("newton", &error);
  SolveOptions options;
  options.relative_tolerance = 1e-12;
  Relaxation result;
  EXPECT_TRUE(Relax(start, Law(alpha), *solver, options, &result, &error))
      << error;
  EXPECT_EQ(result.summary.reason, StopReason::CONVERGED)
      << result.summary.message;
  return result;
}

// With K the stiffness of a contact, f its force and l the spacing: all bonds
// are alike, nothing moves but affinely, and with p = sqrt(3) f / l
//   G = sqrt(3) / 4 (K - 3 f / l), B = sqrt(3) / 2 K + p / 2,
// isotropic.
TEST(LinearResponse, IsThatOfATriangularLattice) {
  for (const double alpha : {2.0, 2.5, 3.0}) {
    const double spacing = 0.98;
    const ElasticResponse r =
        ComputeElasticResponse(Triangular(6, spacing), Law(alpha));
    ASSERT_TRUE(r.found) << r.message;
    const double force = std::pow(0.02, alpha - 1.0);
    const double stiffness = (alpha - 1.0) * std::pow(0.02, alpha - 2.0);
    const double tension = force / spacing;
    const double p = std::sqrt(3.0) * tension;
    const double g = std::sqrt(3.0) / 4.0 * (stiffness - 3.0 * tension);
    const double b = std::sqrt(3.0) / 2.0 * stiffness + 0.5 * p;
    EXPECT_NEAR(r.pressure, p, 1e-13 * p);
    EXPECT_NEAR(r.shear, g, 1e-12 * b);
    EXPECT_NEAR(r.shear_mean, g, 1e-12 * b);
    EXPECT_NEAR(r.bulk_box, b, 1e-12 * b);
    EXPECT_NEAR(r.bulk_growth, b + (alpha - 2.0) * p / 2.0, 1e-12 * b);
    EXPECT_NEAR(r.bulk_affine, r.bulk_growth, 1e-12 * b);
    // exp(t e): C - p in every direction, which is G + sigma_22 - p.
    ASSERT_EQ(r.shear_principal.size(), 2);
    EXPECT_NEAR(r.shear_principal[0], g, 1e-12 * b);
    EXPECT_NEAR(r.shear_principal[1], g, 1e-12 * b);
    EXPECT_LT((r.relaxed - r.affine).cwiseAbs().maxCoeff(), 1e-12 * b);
    const Eigen::MatrixXd voigt = r.Voigt();
    EXPECT_NEAR(voigt(0, 0) - voigt(0, 1), 2.0 * voigt(2, 2), 1e-12 * b);
    EXPECT_NEAR(voigt(0, 2), 0.0, 1e-12 * b);
  }
}

TEST(LinearResponse, HasTheSymmetriesOfAnElasticTensor) {
  for (const char* name : {"n256_phi0.8438_a2_relaxed.xyz",
                           "n1024_a2_p1e-04.xyz",
                           "n64_3d_jammed.xyz"}) {
    const Relaxation state = Relaxed(ReadData(name), 2.0);
    const ElasticResponse r = ComputeElasticResponse(state.packing, Law(2.0));
    ASSERT_TRUE(r.found) << name << ": " << r.message;
    const int d = r.dimension;
    const double size = r.affine.cwiseAbs().maxCoeff();
    for (int i = 0; i < d; ++i) {
      for (int j = 0; j < d; ++j) {
        EXPECT_NEAR(
            r.stress(i, j), state.observables.stress(i, j), 1e-9 * size);
        for (int k = 0; k < d; ++k) {
          for (int l = 0; l < d; ++l) {
            EXPECT_NEAR(r.C(i, j, k, l), r.C(j, i, k, l), 1e-9 * size) << name;
            EXPECT_NEAR(r.C(i, j, k, l), r.C(k, l, i, j), 1e-9 * size) << name;
          }
        }
      }
    }
    EXPECT_NEAR(
        r.bulk_growth, r.bulk_box + (2.0 - d) * r.pressure / d, 1e-9 * size)
        << name;
    // Less than affine.
    const Eigen::MatrixXd drop = r.affine - r.relaxed;
    EXPECT_GT(drop.diagonal().minCoeff(), 0.0) << name;
    EXPECT_LT(r.bulk_growth, r.bulk_affine) << name;
  }
}

// Central differences of relaxed states, at steps so small that the contacts
// stay: errors of the second order in the step.
void ExpectDifferences(const Packing& start, double alpha, double h) {
  const Relaxation state = Relaxed(start, alpha);
  const ElasticResponse r = ComputeElasticResponse(state.packing, Law(alpha));
  ASSERT_TRUE(r.found) << r.message;
  const int d = r.dimension;
  const auto ids = [](const Relaxation& x) {
    std::vector<std::pair<int, int>> pairs;
    for (const Contact& c : x.contacts) pairs.push_back({c.id.i, c.id.j});
    std::sort(pairs.begin(), pairs.end());
    return pairs;
  };
  const auto at = [&](const SmallMatrix& deformation, double growth) {
    Packing packing = state.packing;
    packing.Deform(deformation);
    packing.ScaleRadii(1.0 + growth);
    Relaxation result = Relaxed(packing, alpha);
    EXPECT_EQ(ids(result), ids(state));
    return result.observables;
  };
  const SmallMatrix one = SmallMatrix::Identity(d, d);
  const double size = r.affine.cwiseAbs().maxCoeff();
  const double tolerance = 2e-6 * size;

  const Observables plus = at(SimpleShear(d, h), 0.0);
  const Observables minus = at(SimpleShear(d, -h), 0.0);
  EXPECT_NEAR(-(plus.stress(0, 1) - minus.stress(0, 1)) / (2.0 * h),
              r.shear,
              tolerance);
  // 11 and 22 under the same shear: P = -sigma F^-T, so that of F_12 = h the
  // first derivative is A_1112 = -dsigma_11 + sigma_12 and A_2212 = -dsigma_22.
  EXPECT_NEAR(-(plus.stress(1, 1) - minus.stress(1, 1)) / (2.0 * h),
              r.A(1, 1, 0, 1),
              tolerance);

  const Observables large = at((1.0 + h) * one, 0.0);
  const Observables small = at((1.0 - h) * one, 0.0);
  EXPECT_NEAR(-(large.pressure - small.pressure) / (2.0 * h) / d,
              r.bulk_box,
              tolerance);
  const Observables grown = at(one, h);
  const Observables shrunk = at(one, -h);
  EXPECT_NEAR((grown.pressure - shrunk.pressure) / (2.0 * h) / d,
              r.bulk_growth,
              tolerance);
  for (int i = 0; i < d; ++i) {
    for (int j = 0; j < d; ++j) {
      EXPECT_NEAR(-(grown.stress(i, j) - shrunk.stress(i, j)) / (2.0 * h),
                  r.growth(i, j),
                  tolerance);
    }
  }
}

TEST(LinearResponse, IsTheLimitOfSmallStrains) {
  ExpectDifferences(ReadData("n256_phi0.8438_a2_relaxed.xyz"), 2.0, 1e-9);
  ExpectDifferences(ReadData("n256_phi0.8438_a2.5_relaxed.xyz"), 2.5, 1e-9);
}

TEST(LinearResponse, OfSpheresIsTheLimitOfSmallStrains) {
  Packing packing = ReadData("n64_3d_jammed.xyz");
  packing.ScaleRadii(1.01);
  ExpectDifferences(packing, 2.0, 1e-8);
}

TEST(LinearResponse, KeepsItsBitsInOtherUnits) {
  const Packing packing = ReadData("n256_phi0.8438_a2_relaxed.xyz");
  const ElasticResponse r = ComputeElasticResponse(packing, Law(2.0));
  Packing other = packing;
  const double length = 0x1p-20;
  other.Deform(length * SmallMatrix::Identity(2, 2));
  other.ScaleRadii(length);
  ContactEnergyOptions law = Law(2.0);
  law.stiffness = 0x1p+30;
  const ElasticResponse scaled = ComputeElasticResponse(other, law);
  ASSERT_TRUE(r.found && scaled.found);
  // k has the unit of a modulus in 2D.
  EXPECT_EQ(scaled.relaxed, 0x1p+30 * r.relaxed);
  EXPECT_EQ(scaled.bulk_growth, 0x1p+30 * r.bulk_growth);
}

TEST(LinearResponse, IsNotDefinedWhereNothingIsHeld) {
  const ElasticResponse apart =
      ComputeElasticResponse(Triangular(4, 1.1), Law(2.0));
  EXPECT_FALSE(apart.found);
  EXPECT_NE(apart.message.find("no two"), std::string::npos) << apart.message;
  // Compressed so far that it buckles: K < 3 f / l.
  const ElasticResponse buckled =
      ComputeElasticResponse(Triangular(4, 0.7), Law(2.0));
  EXPECT_FALSE(buckled.found);
  EXPECT_NE(buckled.message.find("no strict minimum"), std::string::npos)
      << buckled.message;
}

}  // namespace
}  // namespace granopt
