#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "granular/flow/near_field.h"
#include "granular/flow/taylor_indices.h"
#include "gtest/gtest.h"
#include "solvers/instruction_set.h"
#include "solvers/random.h"
#include "solvers/threads.h"

namespace granopt {
namespace {

struct Cloud {
  int n;
  int stride;
  std::vector<double> x, weights;
};

// In a cube of side 1 around 0, weights in [0.5, 1.5).
Cloud RandomCloud(int n, std::uint64_t seed) {
  Cloud cloud;
  cloud.n = n;
  cloud.stride = FlowStride(n);
  cloud.x.assign(3 * cloud.stride, 0.0);
  cloud.weights.assign(cloud.stride, 0.0);
  UniformRandom random(seed);
  for (int i = 0; i < n; ++i) {
    for (int k = 0; k < 3; ++k) cloud.x[k * cloud.stride + i] = random() - 0.5;
    cloud.weights[i] = 0.5 + random();
  }
  return cloud;
}

std::vector<RadialLaw> Laws() {
  return {RadialLaw::Powers(0.5, 1.0, 0.25, 2.0),
          RadialLaw::Powers(1.0, 0.0, 0.3, 5.0),
          RadialLaw::Mie(1.0, 0.2, 12.0, 6.0),
          RadialLaw::Powers(0.36, 0.67, 0.26, 1.59),
          RadialLaw::Morse(1.0, 4.0, 0.3)};
}

NearFieldView View(const Cloud& cloud, double period) {
  NearFieldView view;
  view.n = cloud.n;
  for (int k = 0; k < 3; ++k) view.x[k] = cloud.x.data() + k * cloud.stride;
  view.weight = cloud.weights.data();
  view.period = period;
  return view;
}

// In long double, one pair after the other. `size`: sums of magnitudes.
std::vector<long double> Reference(const RadialLaw& law,
                                   const Cloud& cloud,
                                   double period,
                                   std::vector<long double>* size,
                                   long double* energy) {
  std::vector<long double> force(3 * cloud.stride, 0.0L);
  size->assign(cloud.n, 0.0L);
  *energy = 0.0L;
  for (int i = 0; i < cloud.n; ++i) {
    for (int j = 0; j < cloud.n; ++j) {
      if (i == j) continue;
      long double d[3], square = 0.0L;
      for (int k = 0; k < 3; ++k) {
        d[k] = static_cast<long double>(cloud.x[k * cloud.stride + j]) -
               cloud.x[k * cloud.stride + i];
        if (period > 0.0) d[k] -= period * std::nearbyint(d[k] / period);
        square += d[k] * d[k];
      }
      const long double r = std::sqrt(square);
      const long double w =
          static_cast<long double>(cloud.weights[i]) * cloud.weights[j];
      long double f, v;
      if (law.form == RadialLaw::Form::MORSE) {
        const long double e = std::exp(law.steepness * (law.distance - r));
        f = 2.0L * law.depth * law.steepness * (1.0L - e) * e;
        v = law.depth * ((1.0L - e) * (1.0L - e) - 1.0L);
        (*size)[i] += w * 2.0L * law.depth * law.steepness * (1.0L + e) * e;
      } else {
        f = v = 0.0L;
        for (int t = 0; t < 2; ++t) {
          const long double b = law.exponent[t];
          const long double s = t == 0 ? law.strength[0] : -law.strength[1];
          f += s * std::pow(r, -b);
          v += b == 1.0L ? s * std::log(r)
                         : s * std::pow(r, 1.0L - b) / (1.0L - b);
          (*size)[i] += w * std::fabs(s) * std::pow(r, -b);
        }
      }
      for (int k = 0; k < 3; ++k)
        force[k * cloud.stride + i] += w * f * d[k] / r;
      if (j > i) *energy += w * v;
    }
  }
  return force;
}

TEST(NearField, IsTheSumOverPairs) {
  for (const RadialLaw& law : Laws()) {
    for (const double period : {0.0, 1.0}) {
      for (const int n : {2, 3, 7, 8, 9, 31, 100, 1100}) {
        // Several pieces of work, once.
        if (n > 1000 && law.exponent[1] != 2.0) continue;
        const Cloud cloud = RandomCloud(n, n);
        std::string error;
        const auto field =
            NearField::Create({law}, n, cloud.weights, period, &error);
        ASSERT_NE(field, nullptr) << error;
        std::vector<double> force(3 * cloud.stride);
        double energy;
        field->Forces(cloud.x.data(), force.data(), &energy);
        std::vector<long double> size;
        long double exact_energy;
        const auto exact = Reference(law, cloud, period, &size, &exact_energy);
        for (int i = 0; i < n; ++i) {
          for (int k = 0; k < 3; ++k) {
            EXPECT_NEAR(force[k * cloud.stride + i],
                        static_cast<double>(exact[k * cloud.stride + i]),
                        1e-14 * static_cast<double>(size[i]))
                << n << " " << period;
          }
        }
        EXPECT_NEAR(
            energy,
            static_cast<double>(exact_energy),
            2e-14 * std::fabs(static_cast<double>(exact_energy)) + 1e-14 * n);
        for (int i = n; i < cloud.stride; ++i) EXPECT_EQ(force[i], 0.0);
      }
    }
  }
}

// The same bits from every instruction set that this machine has.
TEST(NearField, InstructionSetsAgreeBitwise) {
  for (const RadialLaw& law : Laws()) {
    for (const bool images : {false, true}) {
      std::vector<NearFieldLoops> all = {PortableNearFieldLoops(law, images)};
#ifdef __x86_64__
      if (Runs(InstructionSet::AVX2)) {
        all.push_back(Avx2NearFieldLoops(law, images));
      }
      if (Runs(InstructionSet::AVX512)) {
        all.push_back(Avx512NearFieldLoops(law, images));
      }
#endif
      for (const int n : {1, 5, 8, 13, 64, 101}) {
        const Cloud cloud = RandomCloud(n, 7 + n);
        const NearFieldView view = View(cloud, images ? 1.0 : 0.0);
        std::vector<std::vector<double>> forces, rows;
        std::vector<double> energies, least;
        for (const NearFieldLoops& loops : all) {
          std::vector<double> f(3 * cloud.stride, 0.0);
          double* const parts[3] = {
              f.data(), f.data() + cloud.stride, f.data() + 2 * cloud.stride};
          const NearFieldSums sums =
              loops.triangle(law, view, 0, n, true, parts);
          energies.push_back(sums.energy);
          least.push_back(sums.least_square);
          forces.push_back(f);
          std::vector<double> row(3);
          const double at[3] = {0.01, -0.2, 0.3};
          loops.row(law, view, n / 2, at, true, row.data());
          rows.push_back(row);
        }
        for (std::size_t s = 1; s < all.size(); ++s) {
          EXPECT_EQ(forces[s], forces[0]) << n;
          EXPECT_EQ(rows[s], rows[0]) << n;
          EXPECT_EQ(energies[s], energies[0]) << n;
          EXPECT_EQ(least[s], least[0]) << n;
        }
      }
    }
  }
}

// So do the kernels of the multipole method; and a far sum is what its series
// says: the derivatives of V at the centres, for a source of one moment.
TEST(NearFieldTree, InstructionSetsAgreeBitwise) {
  const TaylorIndices taylor(5);
  for (const RadialLaw& law : {RadialLaw::Powers(0.5, 1.0, 0.25, 2.0),
                               RadialLaw::Powers(0.4, 1.3, 0.3, 3.7)}) {
    std::vector<NearFieldLoops> all = {PortableNearFieldLoops(law, false)};
#ifdef __x86_64__
    if (Runs(InstructionSet::AVX2)) {
      all.push_back(Avx2NearFieldLoops(law, false));
    }
    if (Runs(InstructionSet::AVX512)) {
      all.push_back(Avx512NearFieldLoops(law, false));
    }
#endif
    UniformRandom random(3);
    for (const int sources : {1, 8, 13}) {
      std::vector<double> offset[3], moments(sources * taylor.terms());
      std::vector<const double*> of;
      for (int s = 0; s < sources; ++s) {
        for (int k = 0; k < 3; ++k) offset[k].push_back(1.0 + random());
        for (int n = 0; n < taylor.terms(); ++n) {
          moments[s * taylor.terms() + n] = random();
        }
        of.push_back(&moments[s * taylor.terms()]);
      }
      const double* const offsets[3] = {
          offset[0].data(), offset[1].data(), offset[2].data()};
      const Cloud cloud = RandomCloud(29, 5);
      std::vector<std::vector<double>> locals, forces;
      for (const NearFieldLoops& loops : all) {
        std::vector<double> local(taylor.terms(), 0.0);
        loops.far(
            law, taylor.View(), sources, offsets, of.data(), local.data());
        locals.push_back(local);
        std::vector<double> f(3 * FlowStride(11), 0.0);
        double* const parts[3] = {
            f.data(), f.data() + FlowStride(11), f.data() + 2 * FlowStride(11)};
        loops.cloud(law, View(cloud, 0.0), 11, true, parts);
        forces.push_back(f);
      }
      for (std::size_t s = 1; s < all.size(); ++s) {
        EXPECT_EQ(locals[s], locals[0]);
        EXPECT_EQ(forces[s], forces[0]);
      }
    }
    // V(R - s) = sum D^n V s^n / n!: the sum converges to V elsewhere.
    const TaylorIndices high(kMaxOrder);
    std::vector<double> one(high.terms(), 0.0), local(high.terms(), 0.0),
        y(high.terms());
    one[0] = 1.0;
    const double* const unit = one.data();
    const double R[3] = {1.0, -0.7, 0.4}, s[3] = {0.05, 0.1, -0.08};
    const double* const offsets[3] = {&R[0], &R[1], &R[2]};
    all[0].far(law, high.View(), 1, offsets, &unit, local.data());
    high.Monomials(s, y.data());
    double sum = 0.0, square = 0.0;
    for (int n = 0; n < high.terms(); ++n) sum += local[n] * y[n];
    for (int k = 0; k < 3; ++k) square += (R[k] - s[k]) * (R[k] - s[k]);
    EXPECT_NEAR(sum, EvaluateLaw(law, std::sqrt(square)).potential, 1e-9);
  }
}

TEST(NearField, ThreadsChangeNoBit) {
  const int n = 3000;
  const Cloud cloud = RandomCloud(n, 3);
  std::string error;
  const auto field =
      NearField::Create({Laws()[0]}, n, cloud.weights, 0.0, &error);
  std::vector<double> one(3 * cloud.stride), two = one;
  double energy_one, energy_two;
  field->Forces(cloud.x.data(), one.data(), &energy_one);
  if (!SetNumThreads(2)) GTEST_SKIP() << "built without OpenMP";
  field->Forces(cloud.x.data(), two.data(), &energy_two);
  SetNumThreads(1);
  EXPECT_EQ(one, two);
  EXPECT_EQ(energy_one, energy_two);
}

// -dV/dr by central differences, and the force on one grain is that of the sum
// over all.
TEST(NearField, ForcesAreTheGradientOfTheEnergy) {
  for (const RadialLaw& law : Laws()) {
    for (const double period : {0.0, 1.0}) {
      const int n = 12;
      Cloud cloud = RandomCloud(n, 21);
      std::string error;
      const auto field =
          NearField::Create({law}, n, cloud.weights, period, &error);
      std::vector<double> force(3 * cloud.stride), other = force;
      field->Forces(cloud.x.data(), force.data(), nullptr);
      double scale = 0.0;
      for (const double f : force) scale = std::max(scale, std::fabs(f));
      for (const int i : {0, 5, 11}) {
        double single[3], at[3];
        for (int k = 0; k < 3; ++k) at[k] = cloud.x[k * cloud.stride + i];
        field->ForceOn(i, cloud.x.data(), at, single, nullptr);
        for (int k = 0; k < 3; ++k) {
          double& x = cloud.x[k * cloud.stride + i];
          const double h = 1e-6, x0 = x;
          double up, down;
          x = x0 + h;
          field->Forces(cloud.x.data(), other.data(), &up);
          x = x0 - h;
          field->Forces(cloud.x.data(), other.data(), &down);
          x = x0;
          const double f = force[k * cloud.stride + i];
          EXPECT_NEAR(f, (down - up) / (2.0 * h), 2e-7 * scale);
          EXPECT_NEAR(f, single[k], 1e-13 * scale);
        }
      }
    }
  }
}

TEST(NearField, InternalForcesBalance) {
  // Consistency check (6.10): pair forces are antisymmetric bit by bit, so that
  // only the order of sums is left.
  const int n = 500;
  const Cloud cloud = RandomCloud(n, 5);
  std::string error;
  const auto field =
      NearField::Create({Laws()[3]}, n, cloud.weights, 0.0, &error);
  std::vector<double> force(3 * cloud.stride);
  field->Forces(cloud.x.data(), force.data(), nullptr);
  double magnitude = 0.0, sum[3] = {};
  for (int i = 0; i < n; ++i) {
    for (int k = 0; k < 3; ++k) {
      sum[k] += force[k * cloud.stride + i];
      magnitude += std::fabs(force[k * cloud.stride + i]);
    }
  }
  for (const double s : sum) EXPECT_LE(std::fabs(s), 1e-15 * magnitude);
}

// The multipole method keeps its bound for every grain, and momentum.
TEST(NearFieldTree, KeepsItsBound) {
  const int n = 2000;
  // A cloud with a dense cluster in it.
  Cloud cloud = RandomCloud(n, 11);
  for (int i = 0; i < n / 4; ++i) {
    for (int k = 0; k < 3; ++k) {
      cloud.x[k * cloud.stride + i] =
          0.3 + 0.02 * cloud.x[k * cloud.stride + i];
    }
  }
  for (const RadialLaw& law : {RadialLaw::Powers(0.5, 1.0, 0.25, 2.0),
                               RadialLaw::Powers(0.0, 1.0, 0.3, 2.0),
                               RadialLaw::Powers(0.4, 1.3, 0.3, 3.7)}) {
    std::string error;
    const auto direct =
        NearField::Create({law, 0, 1e-3}, n, cloud.weights, 0.0, &error);
    std::vector<double> exact(3 * cloud.stride), force = exact;
    double exact_energy, energy;
    direct->Forces(cloud.x.data(), exact.data(), &exact_energy);
    // Sums of magnitudes: attraction and repulsion with the same sign.
    std::vector<double> size(n, 0.0);
    for (int i = 0; i < n; ++i) {
      for (int j = 0; j < n; ++j) {
        if (i == j) continue;
        double square = 0.0;
        for (int k = 0; k < 3; ++k) {
          const double d =
              cloud.x[k * cloud.stride + j] - cloud.x[k * cloud.stride + i];
          square += d * d;
        }
        size[i] += cloud.weights[i] * cloud.weights[j] *
                   (law.strength[0] * std::pow(square, -0.5 * law.exponent[0]) +
                    law.strength[1] * std::pow(square, -0.5 * law.exponent[1]));
      }
    }
    double last = 1.0;
    for (const double accuracy : {1e-1, 1e-2, 1e-4, 1e-6}) {
      const auto tree =
          NearField::Create({law, 1, accuracy}, n, cloud.weights, 0.0, &error);
      ASSERT_TRUE(tree->UsesTree());
      tree->Forces(cloud.x.data(), force.data(), &energy);
      double worst = 0.0, sum[3] = {}, magnitude = 0.0;
      for (int i = 0; i < n; ++i) {
        double square = 0.0;
        for (int k = 0; k < 3; ++k) {
          const int e = k * cloud.stride + i;
          square += (force[e] - exact[e]) * (force[e] - exact[e]);
          sum[k] += force[e];
          magnitude += std::fabs(force[e]);
        }
        worst = std::max(worst, std::sqrt(square) / size[i]);
      }
      EXPECT_LE(tree->LastErrorBound(), accuracy);
      EXPECT_LE(worst, tree->LastErrorBound());
      EXPECT_GT(worst, 0.0);
      EXPECT_LT(worst, last);
      last = worst;
      for (const double s : sum) EXPECT_LE(std::fabs(s), 1e-14 * magnitude);
      EXPECT_NEAR(energy, exact_energy, accuracy * std::fabs(exact_energy));
      EXPECT_DOUBLE_EQ(tree->LastLeastDistance(), direct->LastLeastDistance());
      if (SetNumThreads(2)) {
        std::vector<double> again(3 * cloud.stride);
        tree->Forces(cloud.x.data(), again.data(), nullptr);
        SetNumThreads(1);
        EXPECT_EQ(again, force);
      }
    }
  }
}

// Two cells that are far from each other: the bound is the larger one of both
// ways, whichever cell comes first. One has grains 0.05 from its centre, the
// other is small.
TEST(NearFieldTree, BoundIsThatOfBothWays) {
  double bound[2];
  for (const int first : {0, 1}) {
    Cloud cloud = RandomCloud(40, 13);
    for (int i = 0; i < 40; ++i) {
      const bool is_small = (i < 20) == (first == 0);
      for (int k = 0; k < 3; ++k) cloud.x[k * cloud.stride + i] *= 1e-3;
      if (!is_small && i % 20 < 2) {
        cloud.x[cloud.stride + i] += i % 20 == 0 ? 0.05 : -0.05;
      }
      cloud.x[i] += i < 20 ? 0.0 : 1.0;
      cloud.weights[i] = 1.0;
    }
    std::string error;
    const auto tree =
        NearField::Create({Laws()[0], 1, 0.1}, 40, cloud.weights, 0.0, &error);
    std::vector<double> force(3 * cloud.stride);
    tree->Forces(cloud.x.data(), force.data(), nullptr);
    bound[first] = tree->LastErrorBound();
    EXPECT_GT(bound[first], 0.0);
  }
  EXPECT_NEAR(bound[0], bound[1], 0.1 * bound[0]);
}

TEST(NearFieldTree, ServesPowersWithoutImages) {
  const Cloud cloud = RandomCloud(100, 2);
  std::string error;
  const auto uses = [&](const RadialLaw& law, double period) {
    return NearField::Create({law, 1, 1e-2}, 100, cloud.weights, period, &error)
        ->UsesTree();
  };
  EXPECT_TRUE(uses(Laws()[0], 0.0));
  EXPECT_FALSE(uses(Laws()[0], 1.0));
  EXPECT_FALSE(uses(Laws()[3], 0.0));  // beta1 = 0.67
  EXPECT_FALSE(uses(Laws()[4], 0.0));  // Morse
  EXPECT_EQ(
      NearField::Create({Laws()[0], 1, 1e-20}, 100, cloud.weights, 0.0, &error),
      nullptr);
  EXPECT_NE(error.find("must be in [1e-9, 0.1]"), std::string::npos) << error;
}

TEST(NearFieldLaw, EquilibriumAndStability) {
  // (2.7), (2.8): d_e = (alpha2 / alpha1)^(1 / (beta2 - beta1)).
  const RadialLaw law = RadialLaw::Powers(0.5, 1.0, 0.25, 2.0);
  EXPECT_DOUBLE_EQ(EquilibriumDistance(law), 0.5);
  for (const RadialLaw& each : Laws()) {
    const double d = EquilibriumDistance(each);
    const RadialValues at = EvaluateLaw(each, d);
    EXPECT_GT(at.stiffness, 0.0);
    // (A.5): H = V'' n n + (V' / d)(1 - n n) is neutral across the line of
    // centres.
    EXPECT_NEAR(at.force_over_distance, 0.0, 1e-13 * at.stiffness);
    EXPECT_LT(at.potential, EvaluateLaw(each, 0.9 * d).potential);
    EXPECT_LT(at.potential, EvaluateLaw(each, 1.1 * d).potential);
    const double h = 1e-5 * d;
    const RadialValues up = EvaluateLaw(each, d + h);
    const RadialValues down = EvaluateLaw(each, d - h);
    EXPECT_NEAR(at.stiffness,
                (up.force_over_distance * (d + h) -
                 down.force_over_distance * (d - h)) /
                    (2.0 * h),
                1e-7 * at.stiffness);
  }
  EXPECT_EQ(EquilibriumDistance(RadialLaw::Powers(0.5, 2.0, 0.25, 1.0)), 0.0);
  EXPECT_EQ(EquilibriumDistance(RadialLaw::Powers(0.5, 1.0, 0.0, 2.0)), 0.0);
}

TEST(NearFieldLaw, WellsHaveTheirDepth) {
  const RadialLaw lj = RadialLaw::Mie(3.0, 0.2, 12.0, 6.0);
  EXPECT_NEAR(EquilibriumDistance(lj), 0.2 * std::pow(2.0, 1.0 / 6.0), 1e-15);
  EXPECT_NEAR(EvaluateLaw(lj, EquilibriumDistance(lj)).potential, -3.0, 1e-13);
  EXPECT_NEAR(EvaluateLaw(lj, 0.2).potential, 0.0, 1e-12);
  const RadialLaw mie = RadialLaw::Mie(2.0, 0.3, 9.5, 4.25);
  EXPECT_NEAR(
      EvaluateLaw(mie, EquilibriumDistance(mie)).potential, -2.0, 1e-13);
  const RadialLaw morse = RadialLaw::Morse(1.5, 4.0, 0.3);
  EXPECT_NEAR(EvaluateLaw(morse, 0.3).potential, -1.5, 1e-15);
  EXPECT_NEAR(EvaluateLaw(morse, 0.3).stiffness, 2.0 * 1.5 * 16.0, 1e-12);
}

TEST(NearField, CoincidentGrainsAreSeen) {
  Cloud cloud = RandomCloud(20, 8);
  for (int k = 0; k < 3; ++k) {
    cloud.x[k * cloud.stride + 17] = cloud.x[k * cloud.stride + 3];
  }
  for (const RadialLaw& law : Laws()) {
    // Over all pairs, and by the tree where it serves the law.
    for (const int tree_from : {0, 1}) {
      std::string error;
      const auto field = NearField::Create(
          {law, tree_from, 1e-3}, 20, cloud.weights, 0.0, &error);
      ASSERT_NE(field, nullptr) << error;
      std::vector<double> force(3 * cloud.stride);
      field->Forces(cloud.x.data(), force.data(), nullptr);
      EXPECT_EQ(field->LastLeastDistance(), 0.0);
    }
  }
}

TEST(NearField, BadNumbersAreRefused) {
  std::string error;
  EXPECT_EQ(NearField::Create({RadialLaw::Powers(-1.0, 1.0, 0.0, 2.0)},
                              1,
                              std::vector<double>(8, 0.0),
                              0.0,
                              &error),
            nullptr);
  EXPECT_NE(error.find("alpha1 = -1"), std::string::npos) << error;
  EXPECT_EQ(NearField::Create({RadialLaw::Powers(1.0, 1.0, 0.0, NAN)},
                              1,
                              std::vector<double>(8, 0.0),
                              0.0,
                              &error),
            nullptr);
  EXPECT_NE(error.find("beta2"), std::string::npos) << error;
}

}  // namespace
}  // namespace granopt
