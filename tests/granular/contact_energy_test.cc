#include "granular/contact_energy.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>
#include <set>
#include <string>
#include <vector>

#include "granular/observables.h"
#include "granular/quad_residual.h"
#include "gtest/gtest.h"
#include "tests/granular/test_packings.h"

namespace granopt {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

// ---- closed forms: a few grains

TEST(ContactEnergy, TwoDiscsHaveTheClosedFormEnergyAndForce) {
  // Centres (3/4, 1) apart, a distance of 5/4; radii 5/8 and 3/4: an overlap of
  // 1/8, all exact in binary.
  Eigen::MatrixXd x(2, 2);
  x << 4.75, 4.0, 5.0, 4.0;
  const Packing packing = MakePacking(Box::Cube(2, 16.0), x, {0.625, 0.75});
  for (const double alpha : {2.0, 2.5, 3.3}) {
    ContactEnergyOptions options;
    options.alpha = alpha;
    options.stiffness = 3.0;
    const auto energy = MakeEnergy(packing, options);
    const Evaluation e = Evaluate(*energy);
    ASSERT_TRUE(e.ok);
    EXPECT_DOUBLE_EQ(e.energy, 3.0 * std::pow(0.125, alpha) / alpha);
    // dE/dx_0 = -f n with n = (x_0 - x_1) / l: the force pushes 0 away from 1.
    const double force = 3.0 * std::pow(0.125, alpha - 1.0);
    EXPECT_DOUBLE_EQ(e.gradient[0], -0.6 * force);
    EXPECT_DOUBLE_EQ(e.gradient[1], -0.8 * force);
    EXPECT_DOUBLE_EQ(e.gradient[2], 0.6 * force);
    EXPECT_DOUBLE_EQ(e.gradient[3], 0.8 * force);
    EXPECT_DOUBLE_EQ(e.scales.gradient, force);
    EXPECT_DOUBLE_EQ(e.scales.length, 0.125 / (alpha - 1.0));

    const std::vector<Contact> contacts =
        energy->Contacts(Zero(*energy).data());
    ASSERT_EQ(contacts.size(), 1u);
    EXPECT_EQ(contacts[0].id, (GapId{0, 1, {0, 0, 0}}));
    EXPECT_EQ(contacts[0].overlap, 0.125);
    EXPECT_EQ(contacts[0].distance, 1.25);
    EXPECT_DOUBLE_EQ(contacts[0].normal[0], 0.6);
    EXPECT_DOUBLE_EQ(contacts[0].normal[1], 0.8);
    EXPECT_DOUBLE_EQ(contacts[0].force, force);
    EXPECT_DOUBLE_EQ(contacts[0].stiffness,
                     3.0 * (alpha - 1.0) * std::pow(0.125, alpha - 2.0));

    // Moved apart by more than the overlap they do not interact; exactly at
    // contact neither.
    std::vector<double> u = {0.75, 1.0, 0.0, 0.0};
    EXPECT_EQ(Evaluate(*energy, u).energy, 0.0);
    u = {0.075, 0.1, 0.0, 0.0};  // 1/8 along the normal, to rounding
    EXPECT_LT(Evaluate(*energy, u).energy, std::pow(8.0 * kEps, alpha));
    // 1/16 along the normal halves the overlap.
    u = {0.0375, 0.05, 0.0, 0.0};
    EXPECT_NEAR(
        Evaluate(*energy, u).energy / (3.0 * std::pow(0.0625, alpha) / alpha),
        1.0,
        100.0 * kEps);
  }
}

TEST(ContactEnergy, TwoSpheresHaveTheClosedFormEnergyAndForce) {
  // (2, 3, 6) / 4 apart, a distance of 7/4, across a face of the cell.
  Eigen::MatrixXd x(3, 2);
  x << 0.25, 15.75, 3.0, 2.25, 1.0, 15.5;
  const Packing packing = MakePacking(Box::Cube(3, 16.0), x, {1.0, 1.0});
  for (const double alpha : {2.0, 2.5, 3.3}) {
    const auto energy = MakeEnergy(packing, alpha);
    const Evaluation e = Evaluate(*energy);
    EXPECT_DOUBLE_EQ(e.energy, std::pow(0.25, alpha) / alpha);
    const double force = std::pow(0.25, alpha - 1.0);
    for (const int k : {0, 1, 2}) {
      const double n = (k == 0 ? 2.0 : k == 1 ? 3.0 : 6.0) / 7.0;
      EXPECT_DOUBLE_EQ(e.gradient[k], -n * force);
      EXPECT_DOUBLE_EQ(e.gradient[3 + k], n * force);
    }
    const std::vector<Contact> contacts =
        energy->Contacts(Zero(*energy).data());
    ASSERT_EQ(contacts.size(), 1u);
    // x_0 - x_1 + H image = (1/2, 3/4, 3/2).
    EXPECT_EQ(contacts[0].id, (GapId{0, 1, {1, 0, 1}}));
  }
}

TEST(ContactEnergy, ThreeInARowPushTheEndsOutAndTheMiddleByTheDifference) {
  Eigen::MatrixXd x(2, 3);
  x << 2.0, 2.875, 3.625, 2.0, 2.0, 2.0;
  const Packing packing = MakePacking(Box::Cube(2, 8.0), x, {0.5, 0.5, 0.5});
  for (const double alpha : {2.0, 2.5, 3.3}) {
    const Evaluation e = Evaluate(*MakeEnergy(packing, alpha));
    const double left = std::pow(0.125, alpha - 1.0);
    const double right = std::pow(0.25, alpha - 1.0);
    EXPECT_DOUBLE_EQ(e.energy, (0.125 * left + 0.25 * right) / alpha);
    EXPECT_DOUBLE_EQ(e.gradient[0], left);
    EXPECT_DOUBLE_EQ(e.gradient[2], right - left);
    EXPECT_DOUBLE_EQ(e.gradient[4], -right);
    EXPECT_EQ(e.gradient[1], 0.0);
    EXPECT_EQ(e.gradient[3], 0.0);
    EXPECT_EQ(e.gradient[5], 0.0);
    EXPECT_DOUBLE_EQ(e.scales.gradient, 0.5 * (left + right));
    EXPECT_DOUBLE_EQ(e.scales.length, 0.1875 / (alpha - 1.0));
  }
}

TEST(ContactEnergy, AGrainTouchingItsOwnImageHasEnergyAndStressButNoForce) {
  // Period 1 along x, radius 9/16: one contact of overlap 1/8, counted once.
  const Packing packing = MakePacking(
      Box(Matrix2(1.0, 0.0, 0.0, 4.0)), Vector2(0.25, 0.5), {0.5625});
  for (const double alpha : {2.0, 2.5, 3.3}) {
    const auto energy = MakeEnergy(packing, alpha);
    const Evaluation e = Evaluate(*energy);
    EXPECT_DOUBLE_EQ(e.energy, std::pow(0.125, alpha) / alpha);
    EXPECT_EQ(e.gradient, std::vector<double>(2, 0.0));
    const std::vector<Contact> contacts =
        energy->Contacts(Zero(*energy).data());
    ASSERT_EQ(contacts.size(), 1u);
    EXPECT_EQ(contacts[0].id, (GapId{0, 0, {1, 0, 0}}));
    // sigma = f l n (x) n / V, (10).
    const Observables o = Measure(packing, contacts, e.energy);
    EXPECT_DOUBLE_EQ(o.stress(0, 0), std::pow(0.125, alpha - 1.0) / 4.0);
    EXPECT_EQ(o.stress(1, 1), 0.0);
    SparseMatrix hessian;
    ASSERT_TRUE(energy->EvaluateHessian(Zero(*energy).data(), &hessian));
    EXPECT_EQ(hessian.nonZeros(), 3);
    EXPECT_EQ(hessian.norm(), 0.0);
  }
}

// ---- invariances

TEST(ContactEnergy, UniformDisplacementsChangeNothing) {
  for (const int d : {2, 3}) {
    const Packing packing = MixedPacking(d, 1);
    const auto energy = MakeEnergy(packing, 2.5);
    const Evaluation at_rest = Evaluate(*energy);
    const std::vector<Contact> contacts =
        energy->Contacts(Zero(*energy).data());
    // All grains by the same double, across many cells: differences of
    // displacements are exactly zero.
    for (const double shift : {0.1, 0.77, -3.3, 1234.5}) {
      std::vector<double> u(energy->NumParameters());
      for (std::size_t v = 0; v < u.size(); ++v) {
        u[v] = shift * (1.0 + static_cast<double>(v % d));
      }
      ExpectIdentical(Evaluate(*energy, u), at_rest);
      const std::vector<Contact> moved = energy->Contacts(u.data());
      ASSERT_EQ(moved.size(), contacts.size());
      for (std::size_t c = 0; c < moved.size(); ++c) {
        EXPECT_EQ(moved[c].id, contacts[c].id) << "names do not wrap";
      }
    }
    // As another origin, the sums only come in another order.
    Packing shifted = packing;
    for (int i = 0; i < packing.size(); ++i) {
      for (int k = 0; k < d; ++k) {
        shifted.SetPosition(i, k, packing.Position(i, k) + DoubleDouble(0.61));
      }
    }
    const Evaluation e = Evaluate(*MakeEnergy(shifted, 2.5));
    EXPECT_LT(MaxDifference(e.gradient, at_rest.gradient),
              1e-14 * at_rest.scales.gradient);
    EXPECT_NEAR(e.energy / at_rest.energy, 1.0, 1e-14);
  }
}

TEST(ContactEnergy, RenumberingGrainsRenumbersTheGradient) {
  for (const int d : {2, 3}) {
    const Packing packing = MixedPacking(d, 2);
    const int n = packing.size();
    std::vector<int> order(n);
    std::iota(order.begin(), order.end(), 0);
    UniformRandom random(9);
    for (int i = n - 1; i > 0; --i) {
      std::swap(order[i], order[static_cast<int>(random() * (i + 1))]);
    }
    Packing renumbered = packing;
    for (int i = 0; i < n; ++i) {
      for (int k = 0; k < d; ++k) {
        renumbered.SetPosition(i, k, packing.Position(order[i], k));
      }
      renumbered.radii[i] = packing.radii[order[i]];
      renumbered.stiffness[i] = packing.stiffness[order[i]];
    }
    const Evaluation a = Evaluate(*MakeEnergy(packing, 3.3));
    Evaluation b = Evaluate(*MakeEnergy(renumbered, 3.3));
    std::vector<double> back(b.gradient.size());
    for (int i = 0; i < n; ++i) {
      for (int k = 0; k < d; ++k)
        back[d * order[i] + k] = b.gradient[d * i + k];
    }
    EXPECT_LT(MaxDifference(a.gradient, back), 1e-14 * a.scales.gradient);
    EXPECT_NEAR(a.energy / b.energy, 1.0, 1e-14);
  }
}

TEST(ContactEnergy, AnotherCellOfTheSameLatticeHasTheSameEnergy) {
  for (const int d : {2, 3}) {
    const Packing packing = RandomPacking(d, 30, 0.95, 3);
    const Evaluation square = Evaluate(*MakeEnergy(packing, 2.5));
    for (const double gamma : {1.0, -1.0, 5.0}) {
      Packing sheared = packing;  // the cell alone, grains stay where they are
      sheared.box = Box(SimpleShear(d, gamma));
      const Evaluation e = Evaluate(*MakeEnergy(sheared, 2.5));
      EXPECT_LT(MaxDifference(e.gradient, square.gradient),
                1e-14 * square.scales.gradient);
      EXPECT_NEAR(e.energy / square.energy, 1.0, 1e-14);
    }
  }
}

// ---- a pure function of reference and displacement

TEST(ContactEnergy, ValuesDoNotDependOnTheListInUse) {
  for (const int d : {2, 3}) {
    for (const double alpha : {2.0, 2.5, 3.3}) {
      const Packing packing = MixedPacking(d, 5);
      const auto energy = MakeEnergy(packing, alpha);
      const int n = energy->NumParameters();
      const std::vector<double> u =
          RandomVector(n, 0.02 * packing.MeanRadius(), 6);
      const std::vector<double> v = RandomVector(n, 1.0, 7);
      const Evaluation before = Evaluate(*energy, u);
      const std::vector<Contact> contacts = energy->Contacts(u.data());
      std::vector<double> product(n);
      ASSERT_TRUE(energy->HessianTimes(u.data(), v.data(), product.data()));
      const double skin = energy->skin();

      const auto expect_unchanged = [&]() {
        ExpectIdentical(Evaluate(*energy, u), before);
        std::vector<double> again(n);
        ASSERT_TRUE(energy->HessianTimes(u.data(), v.data(), again.data()));
        EXPECT_EQ(again, product);
        const std::vector<Contact> same = energy->Contacts(u.data());
        ASSERT_EQ(same.size(), contacts.size());
        for (std::size_t c = 0; c < same.size(); ++c) {
          EXPECT_EQ(same[c].id, contacts[c].id);
          EXPECT_EQ(same[c].overlap, contacts[c].overlap);
          EXPECT_EQ(same[c].force, contacts[c].force);
        }
      };
      // Far away and back, again and again, with ever larger skins.
      for (int trip = 0; trip < 8; ++trip) {
        const std::int64_t builds = energy->num_list_builds();
        EXPECT_TRUE(Evaluate(*energy, RandomVector(n, 2.0, 100 + trip)).ok);
        expect_unchanged();
        EXPECT_EQ(energy->num_list_builds(), builds + 2);
      }
      EXPECT_GT(energy->skin(), 2.0 * skin);
      // A list that served long gets a smaller skin.
      const double largest = energy->skin();
      for (int k = 0; k < 250; ++k) Evaluate(*energy, u);
      EXPECT_TRUE(Evaluate(*energy, RandomVector(n, 2.0, 200)).ok);
      EXPECT_LT(energy->skin(), largest);
      expect_unchanged();
      // An object that never moved.
      ExpectIdentical(Evaluate(*MakeEnergy(packing, alpha), u), before);
    }
  }
}

TEST(ContactEnergy, StaysExactWhileGrainsCreepThroughTheirSkins) {
  for (const int d : {2, 3}) {
    const Packing packing = RandomPacking(d, 60, 0.9, 12);
    const auto energy = MakeEnergy(packing, 2.0);
    const ContactEnergyOptions options;
    const std::vector<double> direction =
        RandomVector(energy->NumParameters(), 1.0, 13);
    // Steps of a fraction of the smallest skin, so that lists are used up to
    // their limits.
    const double step = 0.004 * packing.radii.minCoeff();
    std::vector<double> u(direction.size());
    for (int k = 0; k < 200; ++k) {
      for (std::size_t v = 0; v < u.size(); ++v) u[v] = k * step * direction[v];
      const Evaluation e = Evaluate(*energy, u);
      if (k % 5 != 0) continue;
      EXPECT_LT(ForceError(e, InQuad(packing, options, u)), 2e-14)
          << "after step " << k;
    }
    EXPECT_GT(energy->num_list_builds(), 3);
  }
}

TEST(ContactEnergy, TakesNullGradientsAndUnalignedVariables) {
  const Packing packing = MixedPacking(2, 14);
  const auto energy = MakeEnergy(packing, 2.5);
  const int n = energy->NumParameters();
  const std::vector<double> u = RandomVector(n, 0.01, 15);
  const Evaluation e = Evaluate(*energy, u);
  double value = kNaN;
  ASSERT_TRUE(energy->Evaluate(u.data(), &value, nullptr));
  EXPECT_EQ(value, e.energy);
  // One double off any wider alignment; the gradient is overwritten.
  std::vector<double> x(n + 1), g(n + 1, 1e300);
  std::copy(u.begin(), u.end(), x.begin() + 1);
  ASSERT_TRUE(energy->Evaluate(x.data() + 1, &value, g.data() + 1));
  EXPECT_EQ(value, e.energy);
  EXPECT_EQ(std::vector<double>(g.begin() + 1, g.end()), e.gradient);
  EXPECT_EQ(g[0], 1e300);
}

TEST(ContactEnergy, RecenterChangesTheLastDigitsOnly) {
  const Packing packing = ReadData("n256_phi0.8438_a2_relaxed.xyz");
  for (const double alpha : {2.0, 2.5, 3.3}) {
    const auto energy = MakeEnergy(packing, alpha);
    const int n = energy->NumParameters();
    const double overlap = (alpha - 1.0) * Evaluate(*energy).scales.length;
    // A transverse wave: neighbours move by a few overlaps with respect to each
    // other, grains by `amplitude` overlaps.
    const auto wave = [&](double amplitude) {
      std::vector<double> u(n, 0.0);
      for (int i = 0; i < packing.size(); ++i) {
        u[2 * i] =
            amplitude * overlap *
            std::sin(2.0 * 3.14159265358979323846 * packing.positions(1, i));
      }
      return u;
    };
    // Not within ten mean overlaps.
    std::vector<double> u = wave(8.0);
    Evaluation e = Evaluate(*energy, u);
    EXPECT_FALSE(energy->Recenter(u.data()));
    ExpectIdentical(Evaluate(*energy, u), e);

    u = wave(40.0);
    e = Evaluate(*energy, u);
    ASSERT_GT(40.0 * overlap, 10.0 * (alpha - 1.0) * e.scales.length);
    const std::vector<double> kept = u;
    EXPECT_TRUE(energy->Recenter(u.data()));
    EXPECT_EQ(u, kept);
    const Evaluation recentered = Evaluate(*energy, u);
    EXPECT_LT(MaxDifference(recentered.gradient, e.gradient),
              1e-14 * e.scales.gradient);
    EXPECT_NEAR(recentered.energy / e.energy, 1.0, 1e-14);
    EXPECT_LT(ForceError(recentered, InQuad(packing, energy->options(), u)),
              1e-14);
    EXPECT_FALSE(energy->Recenter(u.data())) << "already there";
    ExpectIdentical(Evaluate(*energy, u), recentered);
  }
}

TEST(ContactEnergy, RecenterDoesNothingWithoutContacts) {
  Eigen::MatrixXd x(2, 2);
  x << 1.0, 3.0, 1.0, 3.0;
  const auto energy =
      MakeEnergy(MakePacking(Box::Cube(2, 8.0), x, {0.5, 0.5}), 2.0);
  const std::vector<double> u = {0.1, 0.2, 0.3, 0.4};
  const Evaluation e = Evaluate(*energy, u);
  EXPECT_EQ(e.energy, 0.0);
  EXPECT_EQ(e.scales.gradient, 0.0);
  EXPECT_EQ(e.scales.length, 0.0);
  EXPECT_EQ(e.scales.vanishing, 0.0);
  EXPECT_FALSE(energy->Recenter(u.data()));
}

// Greatest distance of two configurations, positions as exact sums hi + lo.
double MaxDistance(const Packing& a, const Packing& b) {
  double most = 0.0;
  for (int i = 0; i < a.size(); ++i) {
    for (int k = 0; k < a.dimension(); ++k) {
      const Quad xa = Quad(a.Position(i, k).hi) + Quad(a.Position(i, k).lo);
      const Quad xb = Quad(b.Position(i, k).hi) + Quad(b.Position(i, k).lo);
      most = std::max(most, std::abs(static_cast<double>(xa - xb)));
    }
  }
  return most;
}

TEST(ContactEnergy, RebaseKeepsTheConfiguration) {
  for (const int d : {2, 3}) {
    const Packing packing = MixedPacking(d, 19);
    const auto energy = MakeEnergy(packing, 2.5);
    const int n = energy->NumParameters();
    for (const double amplitude : {1e-3, 0.4, 30.0}) {
      std::vector<double> u = RandomVector(n, amplitude, 20);
      const Evaluation e = Evaluate(*energy, u);
      const Packing before = energy->Configuration(u.data());
      energy->Recenter(u.data());  // the reference must follow the new origin
      EXPECT_TRUE(energy->Rebase(u.data()));
      EXPECT_EQ(u, std::vector<double>(n, 0.0));
      const Packing after = energy->Configuration(u.data());
      // Double-double: 2^-104 times the displacement.
      EXPECT_LE(MaxDistance(before, after), 1e-31 * (1.0 + amplitude));
      const Evaluation rebased = Evaluate(*energy, u);
      // The state before was evaluated far from its reference.
      EXPECT_LT(
          MaxDifference(rebased.gradient, e.gradient),
          1e-13 * (1.0 + amplitude / e.scales.length) * e.scales.gradient);
      // And it is the function that a start from there has.
      const Evaluation fresh = Evaluate(*MakeEnergy(after, 2.5));
      EXPECT_LT(MaxDifference(rebased.gradient, fresh.gradient),
                1e-14 * e.scales.gradient);
    }
  }
}

TEST(ContactEnergy, ConfigurationIsThePackingMovedAndItsImagesFit) {
  for (const int d : {2, 3}) {
    const Packing packing = MixedPacking(d, 21);
    const auto energy = MakeEnergy(packing, 2.0);
    const std::vector<double> u =
        RandomVector(energy->NumParameters(), 3.0, 22);
    const Packing moved = energy->Configuration(u.data());
    EXPECT_EQ(moved.radii, packing.radii);
    EXPECT_EQ(moved.stiffness, packing.stiffness);
    EXPECT_EQ(moved.species, packing.species);
    EXPECT_EQ(moved.box.edges(), packing.box.edges());
    const QuadResidual at_u = InQuad(packing, energy->options(), u);
    const QuadResidual there =
        InQuad(moved, energy->options(), std::vector<double>(u.size(), 0.0));
    EXPECT_LT(MaxDifference(at_u.gradient, there.gradient),
              2.0 * kEps * MaxAbs(at_u.gradient));
    // x_i - x_j + H image of the packing written is the contact's own vector.
    for (const Contact& c : energy->Contacts(u.data())) {
      SmallVector r = moved.positions.col(c.id.i) - moved.positions.col(c.id.j);
      for (int k = 0; k < d; ++k) {
        r += moved.box.edges().col(k) * c.id.image[k];
      }
      EXPECT_LT((r - c.distance * c.normal).norm(), 1e-13 * moved.box.Length());
    }
  }
}

// ---- gaps

TEST(ContactEnergy, GapNamesSurviveRebuiltListsAndDriftAcrossTheCell) {
  for (const int d : {2, 3}) {
    const Packing packing = MixedPacking(d, 28);
    const auto energy = MakeEnergy(packing, 2.0);
    const int n = energy->NumParameters();
    std::vector<double> u = RandomVector(n, 1e-3, 29);
    Gaps gaps;
    ASSERT_TRUE(energy->EvaluateGaps(u.data(), &gaps));
    std::map<GapId, double> closed;
    for (std::size_t c = 0; c < gaps.ids.size(); ++c) {
      if (gaps.delta[c] > 0.0) closed[gaps.ids[c]] = gaps.delta[c];
    }
    ASSERT_GT(closed.size(), 20u);
    const auto expect_closed = [&](double tolerance) {
      std::size_t found = 0;
      for (std::size_t c = 0; c < gaps.ids.size(); ++c) {
        if (!(gaps.delta[c] > 0.0)) continue;
        ASSERT_EQ(closed.count(gaps.ids[c]), 1u) << "a gap has a new name";
        EXPECT_NEAR(gaps.delta[c], closed[gaps.ids[c]], tolerance);
        ++found;
      }
      EXPECT_EQ(found, closed.size());
    };
    for (int trip = 0; trip < 6; ++trip) {
      ASSERT_TRUE(
          energy->EvaluateGaps(RandomVector(n, 1.0, 30 + trip).data(), &gaps));
      ASSERT_TRUE(energy->EvaluateGaps(u.data(), &gaps));
      expect_closed(0.0);
    }
    std::vector<double> drifted = u;
    for (double& v : drifted) v += 5.375;
    ASSERT_TRUE(energy->EvaluateGaps(drifted.data(), &gaps));
    // The sum u + drift is rounded.
    expect_closed(8.0 * kEps);
  }
}

TEST(ContactEnergy, GapNamesSurviveRebase) {
  const Packing packing = RandomPacking(2, 40, 0.95, 31);
  const auto energy = MakeEnergy(packing, 2.0);
  std::vector<double> u(energy->NumParameters(), 0.375);  // across the faces
  Gaps before, after;
  ASSERT_TRUE(energy->EvaluateGaps(u.data(), &before));
  ASSERT_TRUE(energy->Rebase(u.data()));
  ASSERT_TRUE(energy->EvaluateGaps(u.data(), &after));
  const auto closed = [](const Gaps& gaps) {
    std::set<GapId> ids;
    for (std::size_t c = 0; c < gaps.ids.size(); ++c) {
      if (gaps.delta[c] > 0.0) ids.insert(gaps.ids[c]);
    }
    return ids;
  };
  EXPECT_TRUE(closed(before) == closed(after));
}

}  // namespace
}  // namespace granopt
