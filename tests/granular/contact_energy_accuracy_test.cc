// The digits of the energy: in other units, against quadruple precision, and
// the judge itself.

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "granular/contact_energy.h"
#include "granular/quad_residual.h"
#include "gtest/gtest.h"
#include "tests/granular/test_packings.h"

namespace granopt {
namespace {

// ---- units

// The packing with lengths times 2^b and stiffnesses times 2^a.
Packing InOtherUnits(const Packing& packing, int a, int b) {
  Packing scaled = WithLengths(b, packing);
  scaled.stiffness *= std::ldexp(1.0, a);
  return scaled;
}

TEST(ContactEnergy, OtherUnitsGiveBitwiseTheScaledValues) {
  for (const int d : {2, 3}) {
    for (const double alpha : {2.0, 2.5}) {
      for (const int a : {-30, 0, 7}) {
        for (const int b : {-24, -3, 4, 40}) {
          if (alpha == 2.5 && b % 2 != 0) continue;
          for (const int rule : {-1, 0, 1, 2}) {
            SCOPED_TRACE(testing::Message()
                         << d << "D, alpha = " << alpha << ", a = " << a
                         << ", b = " << b << ", rule " << rule);
            ContactEnergyOptions options;
            options.alpha = alpha;
            Packing packing = MixedPacking(d, 23);
            Packing other;
            ContactEnergyOptions other_options = options;
            if (rule < 0) {
              packing.stiffness.resize(0);
              other = InOtherUnits(packing, 0, b);
              other_options.stiffness = std::ldexp(1.0, a);
            } else {
              options.rule = rule == 0   ? StiffnessRule::MEAN
                             : rule == 1 ? StiffnessRule::SERIES
                                         : StiffnessRule::GEOMETRIC;
              other_options.rule = options.rule;
              other = InOtherUnits(packing, a, b);
            }
            const auto energy = MakeEnergy(packing, options);
            const auto scaled = MakeEnergy(other, other_options);
            const int n = energy->NumParameters();
            const double force =
                std::ldexp(1.0, a) * std::pow(std::ldexp(1.0, b), alpha - 1.0);
            // At rest, nearby, after a rebuilt list, and recentred.
            for (const double amplitude : {0.0, 1e-3, 0.7}) {
              std::vector<double> u = RandomVector(n, amplitude, 24);
              std::vector<double> u_scaled = u;
              for (double& v : u_scaled) v = std::ldexp(v, b);
              for (const bool recentered : {false, true}) {
                if (recentered) {
                  EXPECT_EQ(energy->Recenter(u.data()),
                            scaled->Recenter(u_scaled.data()));
                }
                Evaluation e = Evaluate(*energy, u);
                const Evaluation s = Evaluate(*scaled, u_scaled);
                e.energy *= std::ldexp(force, b);
                for (double& g : e.gradient) g *= force;
                EXPECT_EQ(s.energy, e.energy);
                EXPECT_EQ(s.gradient, e.gradient);
                EXPECT_EQ(s.scales.gradient, force * e.scales.gradient);
                EXPECT_EQ(s.scales.length, std::ldexp(e.scales.length, b));
                // p / (k r^(alpha-d)) has no unit where k is the option's.
                if (rule < 0) {
                  EXPECT_NEAR(
                      s.scales.vanishing / e.scales.vanishing, 1.0, 4.0 * kEps);
                }
              }
              EXPECT_EQ(scaled->num_list_builds(), energy->num_list_builds());
              EXPECT_EQ(scaled->skin(), std::ldexp(energy->skin(), b));
              SparseMatrix hessian, hessian_scaled;
              ASSERT_TRUE(energy->EvaluateHessian(u.data(), &hessian));
              ASSERT_TRUE(
                  scaled->EvaluateHessian(u_scaled.data(), &hessian_scaled));
              hessian *= std::ldexp(force, -b);
              EXPECT_EQ((hessian - hessian_scaled).norm(), 0.0);
            }
          }
        }
      }
    }
  }
}

TEST(ContactEnergy, OtherUnitsScaleOtherPowerLawsToTwelveDigits) {
  const double alpha = 3.3;
  const Packing packing = MixedPacking(2, 25);
  const Evaluation e = Evaluate(*MakeEnergy(packing, alpha));
  for (const int b : {-3, 10}) {
    const Evaluation s =
        Evaluate(*MakeEnergy(InOtherUnits(packing, 2, b), alpha));
    const double force = 4.0 * std::pow(std::ldexp(1.0, b), alpha - 1.0);
    EXPECT_NEAR(s.energy / (std::ldexp(force, b) * e.energy), 1.0, 1e-12);
    std::vector<double> g = e.gradient;
    for (double& x : g) x *= force;
    EXPECT_LT(MaxDifference(s.gradient, g), 1e-12 * s.scales.gradient);
  }
}

TEST(ContactEnergy, ScalesAreTheMeanForceItsLengthAndTheReducedPressure) {
  for (const int d : {2, 3}) {
    for (const double alpha : {2.0, 2.5, 3.3}) {
      const Packing packing = RandomPacking(d, 60, 0.8, 26);
      ContactEnergyOptions options;
      options.alpha = alpha;
      options.stiffness = 2.5;
      const auto energy = MakeEnergy(packing, options);
      const Evaluation e = Evaluate(*energy);
      const Observables o =
          Measure(packing, energy->Contacts(Zero(*energy).data()), e.energy);
      EXPECT_NEAR(e.scales.gradient / o.mean_force, 1.0, 1e-14);
      EXPECT_NEAR((alpha - 1.0) * e.scales.length / o.mean_overlap, 1.0, 1e-14);
      const double reduced =
          o.pressure / (2.5 * std::pow(packing.MeanRadius(), alpha - d));
      const double expected = std::max(std::pow(reduced, 1.0 / (alpha - 1.0)),
                                       o.mean_overlap / packing.MeanRadius());
      EXPECT_NEAR(e.scales.vanishing / expected, 1.0, 1e-13);
    }
  }
}

// Two discs deep in each other in a wide cell: hardly any pressure, not
// nothing.
TEST(ContactEnergy, DeepOverlapsInAWideCellDoNotVanish) {
  Eigen::MatrixXd x(2, 2);
  x << 1.0, 1.4, 1.0, 1.0;
  const Packing packing = MakePacking(Box::Cube(2, 1e9), x, {0.3, 0.3});
  const Evaluation e = Evaluate(*MakeEnergy(packing, 2.0));
  EXPECT_NEAR(e.scales.vanishing, 0.2 / 0.3, 1e-12);
}

// ---- accuracy

class ContactEnergyData : public testing::TestWithParam<const char*> {
 protected:
  void SetUp() override {
    packing_ = ReadData(GetParam());
    ASSERT_GT(packing_.size(), 0);
    options_.alpha = std::stod(packing_.attributes.at("alpha"));
    energy_ = MakeEnergy(packing_, options_);
    n_ = energy_->NumParameters();
  }

  double ErrorAt(const std::vector<double>& u) {
    return ForceError(Evaluate(*energy_, u), InQuad(packing_, options_, u));
  }

  Packing packing_;
  ContactEnergyOptions options_;
  std::unique_ptr<ContactEnergy> energy_;
  int n_ = 0;
};

TEST_P(ContactEnergyData, ForcesAreExactToTheMeanForceAtRest) {
  const std::vector<double> zero(n_, 0.0);
  EXPECT_LT(ErrorAt(zero), 1e-14);
  const Evaluation e = Evaluate(*energy_, zero);
  const QuadResidual quad = InQuad(packing_, options_, zero);
  EXPECT_NEAR(e.energy / quad.energy, 1.0, 1e-14);
}

TEST_P(ContactEnergyData, ForcesAreExactToTheMeanForceTenOverlapsAway) {
  const double overlap =
      Evaluate(*energy_, std::vector<double>(n_, 0.0)).scales.length;
  for (const std::uint64_t seed : {1, 2, 3}) {
    EXPECT_LT(ErrorAt(RandomVector(n_, 10.0 * overlap, seed)), 1e-14);
  }
}

TEST_P(ContactEnergyData, RecenterRestoresTheDigitsAMillionOverlapsAway) {
  const double overlap =
      Evaluate(*energy_, std::vector<double>(n_, 0.0)).scales.length;
  std::vector<double> u = RandomVector(n_, 1e6 * overlap, 4);
  const double there = Evaluate(*energy_, u).scales.length;
  // Overlaps have grown along; only where they have not is there a need.
  EXPECT_EQ(energy_->Recenter(u.data()), MaxAbs(u) > 10.0 * there);
  EXPECT_LT(ErrorAt(u), 1e-14);
  // Ten of the new overlaps on every axis: here neighbours move by up to 28
  // overlaps against each other, more than their radii. A pair that comes as
  // close as d has its direction from r0 + s with an error of eps |s| / d.
  const std::vector<double> on = RandomVector(n_, 10.0 * there, 5);
  for (int v = 0; v < n_; ++v) u[v] += on[v];
  EXPECT_LT(ErrorAt(u), 1e-12);
}

// All grains drift together across the cell while their overlaps stay small.
TEST_P(ContactEnergyData, DriftAcrossTheCellCostsNoDigits) {
  const double overlap =
      Evaluate(*energy_, std::vector<double>(n_, 0.0)).scales.length;
  for (const double drift : {1e6 * overlap, 0.3, -7.7}) {
    std::vector<double> u = RandomVector(n_, 10.0 * overlap, 6);
    for (double& v : u) v += drift;
    Evaluate(*energy_, u);
    EXPECT_TRUE(energy_->Recenter(u.data()));
    EXPECT_LT(ErrorAt(u), 1e-14);
  }
}

INSTANTIATE_TEST_SUITE_P(Files,
                         ContactEnergyData,
                         testing::Values("n256_phi0.8438_a2_relaxed.xyz",
                                         "n256_phi0.8438_a2.5_relaxed.xyz",
                                         "n1024_a2_p1e-04.xyz",
                                         "n1024_a2_p1e-08.xyz"),
                         [](const auto& info) {
                           std::string name = info.param;
                           for (char& c : name) {
                             if (!std::isalnum(static_cast<unsigned char>(c))) {
                               c = '_';
                             }
                           }
                           return name;
                         });

// The judge itself, against the sum over all images in extended precision.
TEST(QuadResidual, AgreesWithTheSumOverAllImages) {
  for (const int d : {2, 3}) {
    for (const bool small : {false, true}) {
      Packing packing = RandomPacking(
          d, small ? 3 : 40, small ? 1.5 : 0.9, 27, SimpleShear(d, -1.3));
      packing.positions_low.setZero(d, packing.size());
      ContactEnergyOptions options;
      options.alpha = 2.5;
      const auto range = [&](int i, int j) {
        return static_cast<long double>(packing.radii[i]) + packing.radii[j];
      };
      long double energy = 0, force = 0;
      Eigen::Matrix<long double, Eigen::Dynamic, Eigen::Dynamic> gradient =
          Eigen::Matrix<long double, Eigen::Dynamic, Eigen::Dynamic>::Zero(
              d, packing.size());
      const std::vector<ImagePair> pairs =
          AllImagePairs(packing.box, packing.positions, range);
      for (const ImagePair& pair : pairs) {
        const int i = pair.id.i;
        const int j = pair.id.j;
        const long double delta = range(i, j) - pair.distance;
        const long double f = delta * std::sqrt(delta);
        energy += f * delta / 2.5L;
        force += f;
        for (int k = 0; k < d; ++k) {
          long double r = static_cast<long double>(packing.positions(k, i)) -
                          packing.positions(k, j);
          for (int c = 0; c < d; ++c) {
            r += static_cast<long double>(packing.box.edges()(k, c)) *
                 pair.id.image[c];
          }
          gradient(k, i) -= f * r / pair.distance;
          gradient(k, j) += f * r / pair.distance;
        }
      }
      const QuadResidual quad = InQuad(
          packing, options, std::vector<double>(d * packing.size(), 0.0));
      const double mean = static_cast<double>(force / pairs.size());
      EXPECT_EQ(quad.contacts, static_cast<int>(pairs.size()));
      EXPECT_NEAR(quad.energy / static_cast<double>(energy), 1.0, kEps);
      EXPECT_NEAR(quad.mean_force / mean, 1.0, 2.0 * kEps);
      double most = 0.0;
      for (int i = 0; i < packing.size(); ++i) {
        for (int k = 0; k < d; ++k) {
          const double g = static_cast<double>(gradient(k, i));
          EXPECT_NEAR(quad.gradient[d * i + k], g, 4.0 * kEps * mean);
          most = std::max(most, std::abs(quad.gradient[d * i + k]));
        }
      }
      EXPECT_EQ(quad.max_gradient, most);
    }
  }
}

}  // namespace
}  // namespace granopt
