// The energy of lattices, against closed forms.

#include <algorithm>
#include <cmath>
#include <vector>

#include "granular/contact_energy.h"
#include "gtest/gtest.h"
#include "tests/granular/test_packings.h"

namespace granopt {
namespace {

// N grains (k = 1) of radius r on a lattice whose bonds have length
// a = 2 r - delta, force f = delta. Every grain sits at a centre of inversion,
// so it stays in equilibrium under any affine strain: affine moduli are exact.
//
// Hexagonal, three bonds a grain at 0, 60 and 120 degrees,
// V / N = sqrt(3) a^2 / 2:
//   E / N = 3 delta^alpha / alpha
//   p  = sum f l / (2 V) = sqrt(3) delta^(alpha-1) / a
//   B  = phi dp/dphi (radii grow, cell fixed) = sqrt(3) r / a  (alpha = 2)
//   B' = -V dp/dV (cell shrinks, radii fixed) = sqrt(3) r / a  (alpha = 2)
// (p depends on r / a alone; for other laws or dimensions p scales like
// length^(alpha-d) and B' - B = p (d - alpha) / d). A simple shear gamma turns
// a bond l n into (l n_x + gamma l n_y, l n_y), with dl/dgamma = l n_x n_y and
// d2l/dgamma2 = l n_y^4 at gamma = 0, so that, with the averages
// <n_x^2 n_y^2> = 1/8 and <n_y^4> = 3/8,
//   G = (1/V) d2E/dgamma2 = d(-sigma_12)/dgamma
//     = (1/V) sum (l^2 n_x^2 n_y^2 - f l n_y^4) = sqrt(3)/4 (1 - 3 delta / a).
//
// Fcc, six bonds a grain along (1, 1, 0) / sqrt(2), V / N = a^3 / sqrt(2):
//   E / N = 6 delta^alpha / alpha,   p = 2 sqrt(2) delta^(alpha-1) / a^2,
//   B = 4 sqrt(2) r / (3 a^2),       B' = B + p / 3,
// and along the cube's axes d2l/dgamma2 = l n_y^2 (1 - n_x^2),
//   G = (1 - 3 delta / a) / (sqrt(2) a).

struct LatticeCase {
  int dimension;
  int contacts_per_grain;
  double volume_per_grain;
  double pressure;      // at delta, alpha = 2, over delta
  double bulk_modulus;  // radii grow
  double shear_modulus;
};

constexpr double kSpacing = 1.5;

LatticeCase Hexagonal(double delta) {
  const double a = kSpacing;
  const double r = 0.5 * (a + delta);
  const double root3 = std::sqrt(3.0);
  return {2,
          3,
          0.5 * root3 * a * a,
          root3 / a,
          root3 * r / a,
          0.25 * root3 * (1.0 - 3.0 * delta / a)};
}

LatticeCase Fcc(double delta) {
  const double a = kSpacing;
  const double r = 0.5 * (a + delta);
  const double root2 = std::sqrt(2.0);
  return {3,
          6,
          a * a * a / root2,
          2.0 * root2 / (a * a),
          4.0 * root2 * r / (3.0 * a * a),
          (1.0 - 3.0 * delta / a) / (root2 * a)};
}

Packing LatticePacking(int dimension, int repeat, double delta) {
  return BravaisLattice(
      dimension == 2 ? HexagonalCell(kSpacing) : FccCell(kSpacing),
      std::vector<int>(dimension, repeat),
      0.5 * (kSpacing + delta));
}

// Second neighbours are sqrt(3) a (hexagonal) or sqrt(2) a (fcc) away, so all
// these overlaps leave six or twelve neighbours.
const double kLatticeOverlaps[] = {1e-6, 1e-3, 0.02, 0.1, 0.3};

TEST(ContactEnergy, LatticesHaveTheClosedFormEnergyAndPressure) {
  for (const double delta : kLatticeOverlaps) {
    for (const LatticeCase& lattice : {Hexagonal(delta), Fcc(delta)}) {
      const int d = lattice.dimension;
      // One grain that touches only itself, cells of a few, and of many.
      for (const int repeat : {1, 2, 3, d == 2 ? 7 : 4}) {
        const Packing packing = LatticePacking(d, repeat, delta);
        for (const double alpha : {2.0, 2.5, 3.3}) {
          SCOPED_TRACE(testing::Message()
                       << d << "D, delta = " << delta << ", repeat = " << repeat
                       << ", alpha = " << alpha);
          const auto energy = MakeEnergy(packing, alpha);
          const Evaluation e = Evaluate(*energy);
          const Observables o = MeasureAtRest(packing, alpha);
          // The cell and the positions are rounded, overlaps are therefore good
          // to a few eps times the cell's length.
          const double tolerance = 10.0 * alpha * repeat * kEps / delta;
          EXPECT_EQ(o.contacts, lattice.contacts_per_grain * packing.size());
          EXPECT_NEAR(
              e.energy / packing.size() /
                  (lattice.contacts_per_grain * std::pow(delta, alpha) / alpha),
              1.0,
              tolerance);
          const double force = std::pow(delta, alpha - 1.0);
          EXPECT_NEAR(o.pressure / (lattice.pressure * force), 1.0, tolerance);
          EXPECT_LT(o.stress_parts.deviatoric / o.pressure, tolerance);
          EXPECT_LT(MaxAbs(e.gradient) / force, tolerance);
          EXPECT_NEAR(packing.box.Volume() / packing.size(),
                      lattice.volume_per_grain,
                      10.0 * kEps * lattice.volume_per_grain);
        }
      }
    }
  }
}

TEST(ContactEnergy, LatticesHaveTheAffineBulkModulusByGrowthAndByCompression) {
  for (const double delta : kLatticeOverlaps) {
    for (const LatticeCase& lattice : {Hexagonal(delta), Fcc(delta)}) {
      const int d = lattice.dimension;
      for (const double alpha : {2.0, 2.5}) {
        SCOPED_TRACE(testing::Message()
                     << d << "D, delta = " << delta << ", alpha = " << alpha);
        const Packing packing = LatticePacking(d, 3, delta);
        const auto grown = [&](double h) {
          Packing p = packing;
          p.ScaleRadii(1.0 + h);
          return MeasureAtRest(p, alpha).pressure;
        };
        const auto compressed = [&](double h) {
          Packing p = packing;
          p.Deform((1.0 - h) * SmallMatrix::Identity(d, d));
          return MeasureAtRest(p, alpha).pressure;
        };
        // A strain h changes overlaps by a h: at most a tenth of delta. Then
        // rounding leaves eps / h, truncation (0.1)^4 / 30 times the fifth
        // derivative of delta^(alpha-1), none for alpha = 2 but from l(h).
        const double h = std::min(1e-3, 0.02 * delta);
        const double p = MeasureAtRest(packing, alpha).pressure;
        const double growth = Derivative(grown, h) / d;
        const double compression = Derivative(compressed, h) / d;
        if (alpha == 2.0) {
          const double tolerance = 1e-11 + 100.0 * kEps / h;
          EXPECT_NEAR(growth / lattice.bulk_modulus, 1.0, tolerance);
          EXPECT_NEAR(compression / (lattice.bulk_modulus + p * (d - 2.0) / d),
                      1.0,
                      tolerance);
        } else {
          EXPECT_NEAR((compression - p * (d - alpha) / d) / growth, 1.0, 1e-5);
        }
      }
    }
  }
}

TEST(ContactEnergy, LatticesHaveTheAffineShearModulusByStressAndByEnergy) {
  for (const double delta : kLatticeOverlaps) {
    for (const LatticeCase& lattice : {Hexagonal(delta), Fcc(delta)}) {
      const int d = lattice.dimension;
      SCOPED_TRACE(testing::Message() << d << "D, delta = " << delta);
      const Packing packing = LatticePacking(d, 3, delta);
      const auto sheared = [&](double gamma) {
        Packing p = packing;
        p.Deform(SimpleShear(d, gamma));
        return MeasureAtRest(p, 2.0);
      };
      const auto stress = [&](double gamma) {
        return sheared(gamma).shear_stress;
      };
      const auto density = [&](double gamma) {
        return sheared(gamma).energy / packing.box.Volume();
      };
      // Truncation h^4 times derivatives of l(gamma), of order a. Roundoff: the
      // sheared cell is rounded, overlaps to some eps, which costs eps / h in
      // the stress and eps delta / h^2 in the energy.
      const double h = std::min(1e-3, 0.02 * delta);
      EXPECT_NEAR(Derivative(stress, h) / lattice.shear_modulus,
                  1.0,
                  1e-10 + 100.0 * kEps / h);
      EXPECT_NEAR(SecondDerivative(density, h) / lattice.shear_modulus,
                  1.0,
                  1e-10 + 500.0 * kEps * delta / (h * h));
      // To first order the stress is G gamma, with the sign of (sec. 2.3).
      EXPECT_GT(stress(h), 0.0);
    }
  }
}

}  // namespace
}  // namespace granopt
