// The energy where it is singular, not defined or refused.

#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "granular/contact_energy.h"
#include "gtest/gtest.h"
#include "tests/granular/test_packings.h"

namespace granopt {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

TEST(ContactEnergy, CoincidentGrainsHaveEnergyButNoForce) {
  for (const int d : {2, 3}) {
    for (const double alpha : {2.0, 2.5, 3.3}) {
      Eigen::MatrixXd x = Eigen::MatrixXd::Constant(d, 2, 3.0);
      const double r[2] = {0.5, 0.75};
      const double expected = std::pow(r[0] + r[1], alpha) / alpha;
      // In place from the start, and by displacement.
      for (const double apart : {0.0, 0.5, 2.0}) {
        x(0, 1) = 3.0 + apart;
        const auto energy =
            MakeEnergy(MakePacking(Box::Cube(d, 16.0), x, {r[0], r[1]}), alpha);
        std::vector<double> u(2 * d, 0.0);
        u[0] = apart;
        const Evaluation e = Evaluate(*energy, u);
        ASSERT_TRUE(e.ok);
        EXPECT_DOUBLE_EQ(e.energy, expected);
        EXPECT_EQ(e.gradient, std::vector<double>(2 * d, 0.0));
        EXPECT_DOUBLE_EQ(e.scales.length, 1.25 / (alpha - 1.0));
        SparseMatrix hessian;
        ASSERT_TRUE(energy->EvaluateHessian(u.data(), &hessian));
        EXPECT_EQ(hessian.norm(), 0.0);
        std::vector<double> product(2 * d, kNaN);
        const std::vector<double> v = RandomVector(2 * d, 1.0, 32);
        ASSERT_TRUE(energy->HessianTimes(u.data(), v.data(), product.data()));
        EXPECT_EQ(product, std::vector<double>(2 * d, 0.0));
        Gaps gaps;
        ASSERT_TRUE(energy->EvaluateGaps(u.data(), &gaps));
        ASSERT_EQ(gaps.delta.size(), 1);
        EXPECT_DOUBLE_EQ(gaps.delta[0], 1.25);
        EXPECT_EQ(gaps.jacobian.norm(), 0.0);
        const std::vector<Contact> contacts = energy->Contacts(u.data());
        ASSERT_EQ(contacts.size(), 1u);
        EXPECT_EQ(contacts[0].normal.norm(), 0.0);
        // And the recentred function.
        if (energy->Recenter(u.data())) {
          EXPECT_DOUBLE_EQ(Evaluate(*energy, u).energy, expected);
        }
        // So close that the square of the distance loses its digits or
        // underflows: the direction may be lost, the force does not exceed its
        // size (1e-320 has three digits).
        for (const double hair :
             {1e-155, 1e-158, 1e-160, 1e-162, 1e-200, 1e-300, 5e-324}) {
          std::vector<double> w = u;
          if (apart != 0.0) break;  // u + hair = u
          w[d - 1] += hair;
          const Evaluation e = Evaluate(*energy, w);
          EXPECT_TRUE(e.ok);
          EXPECT_DOUBLE_EQ(e.energy, expected);
          EXPECT_LE(MaxAbs(e.gradient),
                    (1.0 + 1e-3) * std::pow(1.25, alpha - 1.0))
              << "at a distance of " << hair;
        }
        // A hair apart there is a direction again.
        u[0] += 1e-9;
        const Evaluation near = Evaluate(*energy, u);
        EXPECT_NEAR(near.gradient[0] / -std::pow(1.25, alpha - 1.0), 1.0, 1e-6);
      }
    }
  }
}

TEST(ContactEnergy, MissesAreReportedAndLeaveTheFunctionUsable) {
  for (const int d : {2, 3}) {
    const Packing packing = RandomPacking(d, 30, 0.9, 33);
    const auto energy = MakeEnergy(packing, 2.5);
    const int n = energy->NumParameters();
    const std::vector<double> u = RandomVector(n, 1e-3, 34);
    const Evaluation before = Evaluate(*energy, u);
    for (const double bad :
         {kInfinity, -kInfinity, 1e300, -1e160, 1e30, 1e8, kNaN}) {
      for (const int where : {0, n / 2, n - 1}) {
        SCOPED_TRACE(testing::Message() << bad << " at " << where);
        std::vector<double> w = u;
        w[where] = bad;
        EXPECT_FALSE(Evaluate(*energy, w).ok);
        double value;
        EXPECT_FALSE(energy->Evaluate(w.data(), &value, nullptr));
        SparseMatrix hessian;
        EXPECT_FALSE(energy->EvaluateHessian(w.data(), &hessian));
        std::vector<double> product(n);
        EXPECT_FALSE(energy->HessianTimes(w.data(), u.data(), product.data()));
        Gaps gaps;
        EXPECT_FALSE(energy->EvaluateGaps(w.data(), &gaps));
        EXPECT_TRUE(energy->Contacts(w.data()).empty());
        ExpectIdentical(Evaluate(*energy, u), before);
      }
    }
    // Everywhere.
    EXPECT_FALSE(Evaluate(*energy, std::vector<double>(n, kInfinity)).ok);
    EXPECT_FALSE(Evaluate(*energy, std::vector<double>(n, 1e300)).ok);
    ExpectIdentical(Evaluate(*energy, u), before);
  }
}

TEST(ContactEnergy, NotANumberIsFoundAlsoWhereOtherGrainsHaveMovedFar) {
  const Packing packing = RandomPacking(2, 30, 0.9, 35);
  const auto energy = MakeEnergy(packing, 2.0);
  const int n = energy->NumParameters();
  const Evaluation before = Evaluate(*energy);
  for (const int where : {0, n / 2, n - 1}) {
    std::vector<double> w = RandomVector(n, 1.0, 36);
    w[where] = kNaN;
    EXPECT_FALSE(Evaluate(*energy, w).ok);
  }
  EXPECT_FALSE(Evaluate(*energy, std::vector<double>(n, kNaN)).ok);
  ExpectIdentical(Evaluate(*energy), before);
}

TEST(ContactEnergy, RecenterAndRebaseRefuseWhatIsNotFinite) {
  const Packing packing = RandomPacking(2, 30, 0.9, 37);
  const auto energy = MakeEnergy(packing, 2.0);
  const int n = energy->NumParameters();
  const Evaluation before = Evaluate(*energy);
  for (const double bad : {kNaN, kInfinity}) {
    std::vector<double> w(n, 1.0);
    w[n / 2] = bad;
    EXPECT_FALSE(energy->Recenter(w.data()));
    ExpectIdentical(Evaluate(*energy), before);
    EXPECT_FALSE(energy->Rebase(w.data()));
    EXPECT_EQ(w[0], 1.0);
    ExpectIdentical(Evaluate(*energy), before);
  }
}

// A list needs range / height <= 8. Here that holds with the first skin but not
// with the larger ones that the function would like.
TEST(ContactEnergy, AShortCellIsServedHoweverFarGrainsMove) {
  const double r = 3.85;
  Eigen::MatrixXd x(2, 2);
  x << 0.1, 0.6, 0.2, 0.7;
  const Packing packing = MakePacking(Box::Cube(2, 1.0), x, {r, r});
  const auto energy = MakeEnergy(packing, 2.0);
  std::vector<double> u(4, 0.0);
  for (int k = 0; k < 15; ++k) {
    u[0] = 0.21 * k;
    u[3] = -0.13 * k;
    const Evaluation e = Evaluate(*energy, u);
    ASSERT_TRUE(e.ok) << "at step " << k;
    const QuadResidual quad = InQuad(packing, energy->options(), u);
    EXPECT_NEAR(e.energy / quad.energy, 1.0, 1e-14);
    // Some 400 contacts a grain.
    EXPECT_LT(ForceError(e, quad), 1e-13);
  }
}

TEST(ContactEnergy, CreateRefusesWhatItCannotEvaluate) {
  const Packing packing = RandomPacking(2, 5, 0.8, 38);
  const auto refused = [](const Packing& p,
                          double alpha,
                          double stiffness,
                          const std::string& why) {
    ContactEnergyOptions options;
    options.alpha = alpha;
    options.stiffness = stiffness;
    std::string error;
    EXPECT_EQ(ContactEnergy::Create(p, options, &error), nullptr);
    EXPECT_NE(error.find(why), std::string::npos) << error;
    EXPECT_EQ(error.find('\n'), std::string::npos) << "one line";
  };
  refused(packing, 1.999, 1.0, "alpha");
  refused(packing, kNaN, 1.0, "alpha");
  refused(packing, kInfinity, 1.0, "alpha");
  refused(packing, 2.0, 0.0, "k = ");
  refused(packing, 2.0, -1.0, "k = ");
  refused(packing, 2.0, kNaN, "k = ");
  refused(packing, 2.0, kInfinity, "k = ");
  Packing bad = packing;
  bad.radii[3] = -0.1;
  refused(bad, 2.0, 1.0, "grain 3");
  bad = packing;
  bad.ScaleRadii(100.0);
  refused(bad, 2.0, 1.0, "images");
  refused(Packing(), 2.0, 1.0, "no grains");
}

TEST(ContactEnergy, RefusesUnitsInWhichEnergiesVanishOrOverflow) {
  Eigen::MatrixXd x(2, 2);
  x << 4.75, 4.0, 5.0, 4.0;
  Packing packing = MakePacking(Box::Cube(2, 16.0), x, {0.625, 0.75});
  std::string error;
  ContactEnergyOptions options;
  for (const double k : {1e-150, 1e150}) {
    options.stiffness = k;
    EXPECT_NE(ContactEnergy::Create(packing, options, &error), nullptr);
  }
  for (const double k : {1e-300, 1e300}) {
    options.stiffness = k;
    EXPECT_EQ(ContactEnergy::Create(packing, options, &error), nullptr);
    EXPECT_NE(error.find("other units"), std::string::npos) << error;
  }
  // 1e-1000 is 0, 1e1000 is infinite.
  options = ContactEnergyOptions();
  options.alpha = 10.0;
  for (const double length : {1e-100, 1e100}) {
    Packing scaled = packing;
    scaled.Deform(length * SmallMatrix::Identity(2, 2));
    scaled.ScaleRadii(length);
    EXPECT_EQ(ContactEnergy::Create(scaled, options, &error), nullptr);
    EXPECT_NE(error.find("other units"), std::string::npos) << error;
  }
}

}  // namespace
}  // namespace granopt
