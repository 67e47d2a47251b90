// Gradient, stress, Hessian and gaps of the energy, against differences and
// quadruple precision.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <set>
#include <utility>
#include <vector>

#include "granular/contact_energy.h"
#include "gtest/gtest.h"
#include "tests/granular/test_packings.h"

namespace granopt {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

struct GridCase {
  Packing packing;
  ContactEnergyOptions options;
  std::unique_ptr<ContactEnergy> energy;
  std::vector<double> u;  // of several percent of a radius
  double h = 0.0;         // step of differences, far below the nearest kink
};

// 2D, 3D x alpha = 2, 2.5, 3.3 x square, sheared cell x 16 or more grains,
// three in a cell shorter than two radii x k = 1 or stiffness per grain with
// each rule.
void ForGrid(const std::function<void(GridCase&)>& check) {
  for (const int d : {2, 3}) {
    for (const double alpha : {2.0, 2.5, 3.3}) {
      for (const double gamma : {0.0, 0.49, 3.7}) {
        for (const bool small : {false, true}) {
          for (const int rule : {-1, 0, 1, 2}) {
            SCOPED_TRACE(testing::Message()
                         << d << "D, alpha = " << alpha << ", gamma = " << gamma
                         << (small ? ", small cell" : "") << ", rule " << rule);
            for (std::uint64_t seed = 1;; ++seed) {
              ASSERT_LT(seed, 1000u) << "no smooth configuration found";
              GridCase grid;
              grid.packing = RandomPacking(d,
                                           small    ? 3
                                           : d == 2 ? 20
                                                    : 16,
                                           small ? (d == 2 ? 2.1 : 1.2) : 0.95,
                                           seed,
                                           SimpleShear(d, gamma));
              const int n = grid.packing.size();
              grid.options.alpha = alpha;
              if (rule >= 0) {
                grid.options.rule = rule == 0   ? StiffnessRule::MEAN
                                    : rule == 1 ? StiffnessRule::SERIES
                                                : StiffnessRule::GEOMETRIC;
                grid.options.stiffness = 1.7;
                UniformRandom random(seed);
                grid.packing.stiffness.resize(n);
                for (int i = 0; i < n; ++i) {
                  grid.packing.stiffness[i] = 0.3 + 2.0 * random();
                }
              }
              grid.energy = MakeEnergy(grid.packing, grid.options);
              const double r = grid.packing.MeanRadius();
              grid.u = RandomVector(d * n, 0.05 * r, seed + 77);
              grid.h = 1e-5 * r;
              if (!IsSmooth(*grid.energy, grid.u, 1e-3 * r)) continue;
              if (small) {
                std::set<std::pair<int, int>> pairs;
                bool several_images = false, self = false;
                for (const Contact& c : grid.energy->Contacts(grid.u.data())) {
                  if (!pairs.insert({c.id.i, c.id.j}).second) {
                    several_images = true;
                  }
                  self = self || c.id.i == c.id.j;
                }
                EXPECT_TRUE(several_images);
                EXPECT_TRUE(self);
              }
              check(grid);
              break;
            }
          }
        }
      }
    }
  }
}

TEST(ContactEnergy, EnergyAndGradientAgreeWithQuadruplePrecision) {
  ForGrid([](GridCase& grid) {
    const Evaluation e = Evaluate(*grid.energy, grid.u);
    const QuadResidual quad = InQuad(grid.packing, grid.options, grid.u);
    // Up to twenty contacts a grain, each good to a few eps.
    EXPECT_LT(ForceError(e, quad), 1e-14);
    EXPECT_NEAR(e.energy / quad.energy, 1.0, 1e-14);
    EXPECT_NEAR(e.scales.gradient / quad.mean_force, 1.0, 1e-14);
  });
}

TEST(ContactEnergy, GradientIsTheDerivativeOfTheEnergy) {
  ForGrid([](GridCase& grid) {
    const Evaluation e = Evaluate(*grid.energy, grid.u);
    for (std::size_t v = 0; v < grid.u.size(); ++v) {
      const auto energy_along = [&](double step) {
        std::vector<double> u = grid.u;
        u[v] += step;
        return Evaluate(*grid.energy, u).energy;
      };
      // Roundoff: eps E / h with E of the order of 100 contacts times f delta.
      EXPECT_NEAR(Derivative(energy_along, grid.h),
                  e.gradient[v],
                  1e-7 * e.scales.gradient);
    }
  });
}

TEST(ContactEnergy, HessianIsTheDerivativeOfTheGradient) {
  ForGrid([](GridCase& grid) {
    SparseMatrix hessian;
    ASSERT_TRUE(grid.energy->EvaluateHessian(grid.u.data(), &hessian));
    const int n = grid.energy->NumParameters();
    ASSERT_EQ(hessian.rows(), n);
    ASSERT_EQ(hessian.cols(), n);
    const Eigen::MatrixXd lower = hessian;
    EXPECT_EQ(
        lower.triangularView<Eigen::StrictlyUpper>().toDenseMatrix().norm(),
        0.0);
    const double scale = lower.cwiseAbs().maxCoeff();
    for (int v = 0; v < n; ++v) {
      std::vector<std::vector<double>> g;
      for (const int step : {-2, -1, 1, 2}) {
        std::vector<double> u = grid.u;
        u[v] += step * grid.h;
        g.push_back(Evaluate(*grid.energy, u).gradient);
      }
      for (int row = v; row < n; ++row) {
        const double difference =
            (8.0 * (g[2][row] - g[1][row]) - (g[3][row] - g[0][row])) /
            (12.0 * grid.h);
        // The steps u[v] + h carry errors of eps u / h, roundoff eps f / h.
        EXPECT_NEAR(lower(row, v), difference, 1e-8 * scale)
            << "row " << row << ", column " << v;
      }
    }
  });
}

TEST(ContactEnergy, HessianTimesIsTheHessianTimesAVector) {
  ForGrid([](GridCase& grid) {
    SparseMatrix hessian;
    ASSERT_TRUE(grid.energy->EvaluateHessian(grid.u.data(), &hessian));
    const int n = grid.energy->NumParameters();
    const std::vector<double> v = RandomVector(n, 1.0, 3);
    std::vector<double> product(n, kNaN);  // must be overwritten
    ASSERT_TRUE(
        grid.energy->HessianTimes(grid.u.data(), v.data(), product.data()));
    const Eigen::VectorXd expected =
        hessian.selfadjointView<Eigen::Lower>() *
        Eigen::Map<const Eigen::VectorXd>(v.data(), n);
    // Sums of some twenty terms, each below the largest entry.
    EXPECT_LT((Eigen::Map<const Eigen::VectorXd>(product.data(), n) - expected)
                  .cwiseAbs()
                  .maxCoeff(),
              1e-14 * Eigen::MatrixXd(hessian).cwiseAbs().maxCoeff());
  });
}

TEST(ContactEnergy, HessianHoldsTheLowerTriangleOfEveryNearPair) {
  ForGrid([](GridCase& grid) {
    const int d = grid.packing.dimension();
    const int n = grid.packing.size();
    SparseMatrix hessian;
    ASSERT_TRUE(grid.energy->EvaluateHessian(grid.u.data(), &hessian));
    Gaps gaps;
    ASSERT_TRUE(grid.energy->EvaluateGaps(grid.u.data(), &gaps));
    EXPECT_EQ(static_cast<int>(gaps.ids.size()), grid.energy->num_near_pairs());
    // A full d x d block below the diagonal for each pair of different grains,
    // whatever its number of images, and the lower part of each grain's own.
    std::set<std::pair<int, int>> blocks;
    for (std::size_t c = 0; c < gaps.ids.size(); ++c) {
      const GapId& id = gaps.ids[c];
      if (gaps.delta[c] <= -0.02 * grid.packing.radii.minCoeff()) continue;
      if (id.i != id.j) blocks.insert({id.j, id.i});
    }
    EXPECT_EQ(hessian.nonZeros(),
              n * d * (d + 1) / 2 + d * d * static_cast<int>(blocks.size()));
    EXPECT_TRUE(hessian.isCompressed());
    for (int column = 0; column < hessian.cols(); ++column) {
      int previous = column - 1;
      for (SparseMatrix::InnerIterator entry(hessian, column); entry; ++entry) {
        EXPECT_GT(entry.row(), previous) << "rows must increase";
        previous = static_cast<int>(entry.row());
        const int i = column / d;
        const int j = previous / d;
        EXPECT_TRUE(i == j || blocks.count({j, i}) == 1)
            << "no such pair: " << i << ", " << j;
      }
    }
  });
}

TEST(ContactEnergy, StressIsTheDerivativeOfTheEnergyWithRespectToStrain) {
  for (const int d : {2, 3}) {
    for (const double alpha : {2.0, 2.5, 3.3}) {
      for (const bool small : {false, true}) {
        SCOPED_TRACE(testing::Message() << d << "D, alpha = " << alpha
                                        << (small ? ", small cell" : ""));
        Packing packing;
        std::uint64_t seed = 0;
        do {
          packing = RandomPacking(d,
                                  small ? 2 : 25,
                                  small ? 1.5 : 0.95,
                                  ++seed,
                                  SimpleShear(d, 0.4));
          ASSERT_LT(seed, 1000u);
        } while (!IsSmooth(*MakeEnergy(packing, alpha),
                           std::vector<double>(d * packing.size(), 0.0),
                           1e-3 * packing.MeanRadius()));
        const Observables o = MeasureAtRest(packing, alpha);
        const double volume = packing.box.Volume();
        // Roundoff: eps E / h, with E comparable with p V.
        const double h = 1e-5;
        for (int a = 0; a < d; ++a) {
          for (int b = 0; b < d; ++b) {
            const auto strained = [&](double strain) {
              Packing p = packing;
              SmallMatrix deformation = SmallMatrix::Identity(d, d);
              deformation(a, b) += strain;
              p.Deform(deformation);
              return Evaluate(*MakeEnergy(p, alpha)).energy;
            };
            // dE = -V sigma : d epsilon, stress positive in compression.
            EXPECT_NEAR(-Derivative(strained, h) / volume,
                        o.stress(a, b),
                        1e-8 * o.pressure);
          }
        }
        // p = -dE/dV.
        const auto compressed = [&](double h_volume) {
          Packing p = packing;
          p.Deform(std::pow(1.0 + h_volume, 1.0 / d) *
                   SmallMatrix::Identity(d, d));
          return Evaluate(*MakeEnergy(p, alpha)).energy;
        };
        EXPECT_NEAR(
            -Derivative(compressed, h) / volume, o.pressure, 1e-8 * o.pressure);
      }
    }
  }
}

TEST(ContactEnergy, PatternStaysUntilAnotherPairTouches) {
  const Packing packing = RandomPacking(2, 40, 0.9, 4);
  const auto energy = MakeEnergy(packing, 2.0);
  std::vector<double> u = Zero(*energy);
  SparseMatrix first;
  ASSERT_TRUE(energy->EvaluateHessian(u.data(), &first));
  const std::int64_t version = energy->PatternVersion();
  const SparseMatrix kept = first;
  const double* storage = first.valuePtr();

  // Too little for a pair outside of the pattern to touch: same pattern, other
  // values, same storage.
  for (std::size_t v = 0; v < u.size(); ++v) {
    u[v] = (v % 3 == 0 ? 0.004 : -0.003) * packing.radii.minCoeff();
  }
  ASSERT_TRUE(energy->EvaluateHessian(u.data(), &first));
  EXPECT_EQ(energy->PatternVersion(), version);
  ASSERT_EQ(first.nonZeros(), kept.nonZeros());
  EXPECT_TRUE(std::equal(first.innerIndexPtr(),
                         first.innerIndexPtr() + first.nonZeros(),
                         kept.innerIndexPtr()));
  EXPECT_TRUE(std::equal(first.outerIndexPtr(),
                         first.outerIndexPtr() + first.cols() + 1,
                         kept.outerIndexPtr()));
  EXPECT_GT((first - kept).norm(), 0.0);
  EXPECT_EQ(first.valuePtr(), storage);

  // Further, and further than the skin: other pairs touch.
  for (double& v : u) v *= 10.0;
  ASSERT_TRUE(energy->EvaluateHessian(u.data(), &first));
  const std::int64_t second = energy->PatternVersion();
  EXPECT_NE(second, version);
  u = RandomVector(energy->NumParameters(), 1.0, 8);
  ASSERT_TRUE(energy->EvaluateHessian(u.data(), &first));
  EXPECT_NE(energy->PatternVersion(), second);
  EXPECT_GT(energy->num_list_builds(), 1);
}

TEST(ContactEnergy, ForcesAddUpToZero) {
  ForGrid([](GridCase& grid) {
    const Evaluation e = Evaluate(*grid.energy, grid.u);
    const int d = grid.packing.dimension();
    for (int k = 0; k < d; ++k) {
      double sum = 0.0;
      for (int i = 0; i < grid.packing.size(); ++i) {
        sum += e.gradient[d * i + k];
      }
      EXPECT_LT(std::abs(sum), 1e-14 * grid.packing.size() * e.scales.gradient);
    }
  });
}

// ---- gaps

TEST(ContactEnergy, GapsMakeUpTheEnergy) {
  ForGrid([](GridCase& grid) {
    Gaps gaps;
    ASSERT_TRUE(grid.energy->EvaluateGaps(grid.u.data(), &gaps));
    ASSERT_EQ(gaps.delta.size(), static_cast<int>(gaps.ids.size()));
    ASSERT_EQ(gaps.stiffness.size(), gaps.delta.size());
    const double alpha = grid.energy->Exponent();
    EXPECT_EQ(alpha, grid.options.alpha);
    double sum = 0.0;
    Eigen::VectorXd force(gaps.delta.size());
    std::vector<GapId> closed;
    for (int c = 0; c < gaps.delta.size(); ++c) {
      const double delta = std::max(gaps.delta[c], 0.0);
      sum += gaps.stiffness[c] * std::pow(delta, alpha) / alpha;
      force[c] =
          delta > 0.0 ? gaps.stiffness[c] * std::pow(delta, alpha - 1.0) : 0.0;
      if (delta > 0.0) closed.push_back(gaps.ids[c]);
      if (c > 0) {
        EXPECT_TRUE(gaps.ids[c - 1] < gaps.ids[c]);
      }
    }
    const Evaluation e = Evaluate(*grid.energy, grid.u);
    EXPECT_NEAR(sum / e.energy, 1.0, 1e-14);
    // dE/du = sum f d(delta)/du.
    const Eigen::VectorXd gradient = gaps.jacobian.transpose() * force;
    EXPECT_LT(
        MaxDifference(std::vector<double>(gradient.data(),
                                          gradient.data() + gradient.size()),
                      e.gradient),
        1e-14 * e.scales.gradient);
    // The closed ones are the contacts.
    const std::vector<Contact> contacts = grid.energy->Contacts(grid.u.data());
    ASSERT_EQ(closed.size(), contacts.size());
    for (std::size_t c = 0; c < closed.size(); ++c) {
      EXPECT_EQ(closed[c], contacts[c].id);
    }
  });
}

TEST(ContactEnergy, GapJacobianIsTheDerivativeOfTheGaps) {
  ForGrid([](GridCase& grid) {
    if (grid.options.alpha != 2.0) return;  // the law does not enter
    Gaps gaps;
    ASSERT_TRUE(grid.energy->EvaluateGaps(grid.u.data(), &gaps));
    const Eigen::MatrixXd jacobian = gaps.jacobian;
    for (int v = 0; v < grid.energy->NumParameters(); ++v) {
      std::vector<Gaps> at(4);
      for (int k = 0; k < 4; ++k) {
        std::vector<double> u = grid.u;
        u[v] += (k < 2 ? k - 2 : k - 1) * grid.h;
        ASSERT_TRUE(grid.energy->EvaluateGaps(u.data(), &at[k]));
        ASSERT_EQ(at[k].ids, gaps.ids);
      }
      const Eigen::VectorXd difference =
          (8.0 * (at[2].delta - at[1].delta) - (at[3].delta - at[0].delta)) /
          (12.0 * grid.h);
      // Roundoff: eps u / h with u of 5000 h.
      EXPECT_LT((difference - jacobian.col(v)).cwiseAbs().maxCoeff(), 1e-9);
    }
  });
}

// sum a_c (grad delta)(grad delta)^T from the Jacobian, and sum b_c Hess(delta)
// from differences of sum b_c grad(delta_c).
TEST(ContactEnergy, WeightedHessianIsMadeOfTheDerivativesOfTheGaps) {
  ForGrid([](GridCase& grid) {
    if (grid.options.alpha != 2.0) return;  // the law does not enter
    const int n = grid.energy->NumParameters();
    Gaps gaps;
    ASSERT_TRUE(grid.energy->EvaluateGaps(grid.u.data(), &gaps));
    const auto m = static_cast<int>(gaps.ids.size());
    const std::vector<double> a = RandomVector(m, 1.0, 51);
    const std::vector<double> b = RandomVector(m, 1.0, 52);
    const auto weights_a = Eigen::Map<const Eigen::VectorXd>(a.data(), m);
    const auto weights_b = Eigen::Map<const Eigen::VectorXd>(b.data(), m);
    SparseMatrix first, both;
    const std::vector<double> zero(m, 0.0);
    ASSERT_TRUE(grid.energy->EvaluateWeightedHessian(
        grid.u.data(), a.data(), zero.data(), &first));
    ASSERT_TRUE(grid.energy->EvaluateWeightedHessian(
        grid.u.data(), a.data(), b.data(), &both));
    const Eigen::MatrixXd jacobian = gaps.jacobian;
    const Eigen::MatrixXd lower =
        (jacobian.transpose() * weights_a.asDiagonal() * jacobian)
            .triangularView<Eigen::Lower>();
    EXPECT_LT((Eigen::MatrixXd(first) - lower).cwiseAbs().maxCoeff(), 1e-13);
    const Eigen::MatrixXd second = Eigen::MatrixXd(both - first);
    for (int v = 0; v < n; ++v) {
      std::vector<Eigen::VectorXd> at(4);
      for (int k = 0; k < 4; ++k) {
        std::vector<double> u = grid.u;
        u[v] += (k < 2 ? k - 2 : k - 1) * grid.h;
        ASSERT_TRUE(grid.energy->EvaluateGaps(u.data(), &gaps));
        at[k] = gaps.jacobian.transpose() * weights_b;
      }
      const Eigen::VectorXd difference =
          (8.0 * (at[2] - at[1]) - (at[3] - at[0])) / (12.0 * grid.h);
      for (int row = v; row < n; ++row) {
        EXPECT_NEAR(difference[row], second(row, v), 1e-7);
      }
    }
  });
}

}  // namespace
}  // namespace granopt
