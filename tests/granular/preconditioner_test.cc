// What each preconditioner is, against matrices made in another way, and when
// it is made anew.

#include "solvers/preconditioner.h"

#include <cmath>
#include <cstddef>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "Eigen/Dense"
#include "gtest/gtest.h"
#include "solvers/monitor.h"
#include "solvers/registry.h"
#include "tests/granular/test_packings.h"

namespace granopt {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

// A preconditioner of an energy, made at u.
class Made {
 public:
  Made(ContactEnergy* energy,
       const std::string& name,
       std::map<std::string, std::string> values = {})
      : energy_(energy), monitor_(energy, SolveOptions(), "test") {
    ListPreconditioners();
    Parameters parameters(std::move(values));
    p_ = internal::FindPreconditioner(name)(&parameters);
    std::string error;
    EXPECT_TRUE(p_->Supports(*energy, &error)) << error;
  }

  // True if P was made anew.
  bool Update(const std::vector<double>& u, const std::vector<double>* step) {
    at_ = Evaluate(*energy_, u);
    return p_->Update({u.data(), at_.energy, at_.gradient.data(), at_.scales},
                      step == nullptr ? nullptr : step->data(),
                      &monitor_);
  }

  // P, column by column.
  MatrixXd Matrix() const {
    const int n = energy_->NumParameters();
    MatrixXd p(n, n);
    for (int k = 0; k < n; ++k) {
      const VectorXd e = VectorXd::Unit(n, k);
      p_->Multiply(e.data(), p.col(k).data());
    }
    return p;
  }

  // P^-1 is P's inverse, P is symmetric and positive definite.
  void ExpectConsistent() {
    const int n = energy_->NumParameters();
    const MatrixXd p = Matrix();
    EXPECT_LE((p - p.transpose()).norm(), 1e-14 * p.norm());
    const Eigen::SelfAdjointEigenSolver<MatrixXd> eigen(p);
    EXPECT_GT(eigen.eigenvalues()[0], 0.0);
    const double condition =
        eigen.eigenvalues()[n - 1] / eigen.eigenvalues()[0];
    const std::vector<double> r = RandomVector(n, 1.0, 3);
    const Eigen::Map<const VectorXd> right(r.data(), n);
    VectorXd z(n);
    p_->Solve(r.data(), z.data(), &monitor_);
    EXPECT_LE((p * z - right).norm(), 1e-14 * condition * right.norm());
    const std::vector<double> v = RandomVector(n, 1.0, 4);
    const Eigen::Map<const VectorXd> other(v.data(), n);
    EXPECT_NEAR(
        p_->Dot(r.data(), v.data(), n), right.dot(p * other), 1e-12 * p.norm());
  }

  double kappa() const { return at_.scales.gradient / at_.scales.length; }
  const Evaluation& at() const { return at_; }
  int num_fallbacks() const { return p_->num_fallbacks(); }
  Monitor& monitor() { return monitor_; }

 private:
  ContactEnergy* energy_;
  Monitor monitor_;
  std::unique_ptr<Preconditioner> p_;
  Evaluation at_;
};

MatrixXd Dense(const SparseMatrix& lower) {
  const MatrixXd dense(lower);
  return dense.selfadjointView<Eigen::Lower>();
}

MatrixXd Stiffness(const ContactEnergy& energy,
                   const std::vector<double>& u,
                   double prestress) {
  SparseMatrix h;
  EXPECT_TRUE(energy.EvaluateStiffness(u.data(), prestress, &h));
  return Dense(h);
}

Packing Jammed(double alpha, double growth) {
  Packing packing = ReadData("n64_jammed.xyz");
  packing.ScaleRadii(1.0 + growth);
  packing.Perturb(1e-3 * growth, alpha == 2.0 ? 1 : 2);
  return packing;
}

// ---- laplacian --------------------------------------------------------------

// (19)-(22) from the definitions, every pair of images within r_cut.
MatrixXd Laplacian(const ContactEnergy& energy,
                   double decay,
                   double cut,
                   double stabilizer,
                   double fallback) {
  const std::vector<double> zero = Zero(energy);
  const Packing packing = energy.Configuration(zero.data());
  const int n = packing.size(), d = packing.dimension();
  const double r_cut = cut * packing.radii.maxCoeff();
  std::vector<double> nearest(n, r_cut);
  const auto pairs = AllImagePairs(
      packing.box, packing.positions, [&](int, int) { return r_cut; });
  for (const ImagePair& pair : pairs) {
    const double r = static_cast<double>(pair.distance);
    nearest[pair.id.i] = std::min(nearest[pair.id.i], r);
    nearest[pair.id.j] = std::min(nearest[pair.id.j], r);
  }
  double r_nn = 0.0;
  for (const double r : nearest) r_nn += r / n;
  MatrixXd p = stabilizer * MatrixXd::Identity(n * d, n * d);
  for (const ImagePair& pair : pairs) {
    const int i = pair.id.i, j = pair.id.j;
    if (i == j) continue;
    const double c =
        std::exp(-decay * (static_cast<double>(pair.distance) / r_nn - 1.0));
    for (int k = 0; k < d; ++k) {
      p(d * i + k, d * i + k) += c;
      p(d * j + k, d * j + k) += c;
      p(d * i + k, d * j + k) -= c;
      p(d * j + k, d * i + k) -= c;
    }
  }
  VectorXd nu(n * d);
  const MatrixXd s = packing.box.inverse() * packing.positions;
  for (int i = 0; i < n; ++i) {
    for (int k = 0; k < d; ++k) {
      nu[d * i + k] = 1e-3 * r_cut * std::sin(2.0 * M_PI * s(k, i));
    }
  }
  const Evaluation here = Evaluate(energy, zero);
  const Evaluation there =
      Evaluate(energy, std::vector<double>(nu.begin(), nu.end()));
  double nu_dg = 0.0;
  for (int v = 0; v < n * d; ++v) {
    nu_dg += nu[v] * (there.gradient[v] - here.gradient[v]);
  }
  const double mu = nu_dg / nu.dot(p * nu);
  return (fallback > 0.0 ? fallback : mu) * p;
}

TEST(LaplacianPreconditioner, IsTheFormula) {
  for (const int dimension : {2, 3}) {
    const Packing packing =
        dimension == 2 ? Jammed(2.0, 1e-2) : ReadData("n64_3d_jammed.xyz");
    for (const double decay : {0.0, 3.0}) {
      for (const double stabilizer : {0.1, 2.0}) {
        const auto energy = MakeEnergy(packing, 2.0);
        Made made(energy.get(),
                  "laplacian",
                  {{"A", decay == 0.0 ? "0" : "3"},
                   {"C_stab", stabilizer == 0.1 ? "0.1" : "2"},
                   {"r_cut", "2.5"}});
        EXPECT_TRUE(made.Update(Zero(*energy), nullptr));
        const MatrixXd expected =
            Laplacian(*energy, decay, 2.5, stabilizer, 0.0);
        const MatrixXd p = made.Matrix();
        EXPECT_LE((p - expected).norm(), 1e-11 * expected.norm());
        EXPECT_GT(p(0, 0), 0.0);
        made.ExpectConsistent();
        EXPECT_EQ(made.num_fallbacks(), 0);
        EXPECT_EQ(made.monitor().counters().evaluations, 1);
        EXPECT_EQ(made.monitor().counters().factorizations, 1);
      }
    }
  }
}

// Where grains are pressed together so hard that moving aside lowers the
// energy, (21) is negative: mu is then the stiffness scale.
TEST(LaplacianPreconditioner, FallsBackWhereTheProbeIsNegative) {
  Eigen::MatrixXd positions(2, 2);
  positions << 0.0, 0.5, 0.25, 0.3;
  const Packing packing =
      MakePacking(Box::Cube(2, 1.0), positions, {0.45, 0.45});
  for (const double alpha : {2.0, 2.5}) {
    const auto energy = MakeEnergy(packing, alpha);
    const MatrixXd probed = Laplacian(*energy, 0.0, 2.2, 0.1, 0.0);
    ASSERT_LT(probed(0, 0), 0.0);
    Made made(energy.get(), "laplacian");
    made.Update(Zero(*energy), nullptr);
    const MatrixXd expected = Laplacian(*energy, 0.0, 2.2, 0.1, made.kappa());
    EXPECT_LE((made.Matrix() - expected).norm(), 1e-12 * expected.norm());
    made.ExpectConsistent();
  }
}

// Made anew once a grain has moved by r_cut / 4, in however many steps.
TEST(LaplacianPreconditioner, IsMadeAnewAfterALongWay) {
  const Packing packing = Jammed(2.0, 1e-2);
  const auto energy = MakeEnergy(packing, 2.0);
  Made made(energy.get(), "laplacian");
  std::vector<double> u = Zero(*energy), step = u;
  made.Update(u, nullptr);
  const double quarter = 0.25 * 2.2 * packing.radii.maxCoeff();
  // To and fro is no way.
  step[7] = 0.9 * quarter;
  for (int k = 0; k < 6; ++k) {
    EXPECT_FALSE(made.Update(u, &step)) << k;
    step[7] = -step[7];
  }
  step[7] = 0.3 * quarter;
  int steps = 0;
  while (!made.Update(u, &step)) ++steps;
  EXPECT_EQ(steps, 3);
  EXPECT_FALSE(made.Update(u, &step));
}

// ---- contact, hessian -------------------------------------------------------

TEST(ContactPreconditioner, IsTheStiffnessWithoutPrestress) {
  for (const double alpha : {2.0, 2.5}) {
    const auto energy = MakeEnergy(Jammed(alpha, 1e-2), alpha);
    Made made(energy.get(), "contact", {{"shift", "0.05"}});
    EXPECT_TRUE(made.Update(Zero(*energy), nullptr));
    const int n = energy->NumParameters();
    const MatrixXd expected = Stiffness(*energy, Zero(*energy), 0.0) +
                              0.05 * made.kappa() * MatrixXd::Identity(n, n);
    EXPECT_LE((made.Matrix() - expected).norm(), 1e-13 * expected.norm());
    made.ExpectConsistent();
  }
}

TEST(HessianPreconditioner, IsTheHessianShifted) {
  for (const double alpha : {2.0, 2.5}) {
    const auto energy = MakeEnergy(Jammed(alpha, 1e-4), alpha);
    Made made(energy.get(), "hessian", {{"shift", "0.05"}});
    EXPECT_TRUE(made.Update(Zero(*energy), nullptr));
    const int n = energy->NumParameters();
    const MatrixXd expected = Stiffness(*energy, Zero(*energy), 1.0) +
                              0.05 * made.kappa() * MatrixXd::Identity(n, n);
    EXPECT_LE((made.Matrix() - expected).norm(), 1e-13 * expected.norm());
    made.ExpectConsistent();
    EXPECT_EQ(made.monitor().counters().factorizations, 1);
  }
}

// An indefinite Hessian is shifted further until it is not.
TEST(HessianPreconditioner, RaisesItsShift) {
  const auto energy = MakeEnergy(RandomPacking(2, 40, 1.3, 8), 2.0);
  const MatrixXd h = Stiffness(*energy, Zero(*energy), 1.0);
  const double least =
      Eigen::SelfAdjointEigenSolver<MatrixXd>(h).eigenvalues()[0];
  ASSERT_LT(least, -0.1);
  Made made(energy.get(), "hessian");
  made.Update(Zero(*energy), nullptr);
  EXPECT_GT(made.monitor().counters().factorizations, 1);
  EXPECT_EQ(made.num_fallbacks(), 0);
  made.ExpectConsistent();
  // A multiple of 1 apart, and not more than it takes.
  const MatrixXd shift = made.Matrix() - h;
  EXPECT_LE(
      (shift - shift(0, 0) * MatrixXd::Identity(h.rows(), h.cols())).norm(),
      1e-12 * h.norm());
  EXPECT_GT(shift(0, 0), -least);
  EXPECT_LT(shift(0, 0), -5.0 * least);
}

// Every 20 steps, at the iterate that there is then.
TEST(HessianPreconditioner, IsMadeAnewEveryTwentySteps) {
  for (const char* name : {"hessian", "contact", "block_jacobi"}) {
    SCOPED_TRACE(name);
    const auto energy = MakeEnergy(Jammed(2.0, 1e-2), 2.0);
    Made made(energy.get(), name);
    std::vector<double> u = Zero(*energy);
    const std::vector<double> step = RandomVector(u.size(), 1e-5, 6);
    made.Update(u, nullptr);
    const MatrixXd first = made.Matrix();
    for (int k = 1; k <= 45; ++k) {
      for (std::size_t i = 0; i < u.size(); ++i) u[i] += step[i];
      EXPECT_EQ(made.Update(u, &step), k % 20 == 0) << k;
      EXPECT_TRUE(k >= 20 || (made.Matrix() - first).norm() == 0.0) << k;
    }
    EXPECT_GT((made.Matrix() - first).norm(), 1e-8 * first.norm());
    EXPECT_EQ(made.monitor().counters().hessians, 3);
  }
}

// ---- block_jacobi -----------------------------------------------------------

TEST(BlockJacobiPreconditioner, IsTheBlocksWithPositiveEigenvalues) {
  const auto energy = MakeEnergy(RandomPacking(2, 40, 1.3, 8), 2.0);
  Made made(energy.get(), "block_jacobi", {{"floor", "0.2"}});
  made.Update(Zero(*energy), nullptr);
  const MatrixXd h = Stiffness(*energy, Zero(*energy), 1.0);
  MatrixXd expected = MatrixXd::Zero(h.rows(), h.cols());
  int negative = 0, low = 0;
  for (int b = 0; b < h.rows(); b += 2) {
    const Eigen::SelfAdjointEigenSolver<MatrixXd> eigen(h.block(b, b, 2, 2));
    VectorXd values = eigen.eigenvalues();
    for (double& v : values) {
      negative += v < 0.0 ? 1 : 0;
      low += std::abs(v) < 0.2 * made.kappa() ? 1 : 0;
      v = std::max(std::abs(v), 0.2 * made.kappa());
    }
    expected.block(b, b, 2, 2) = eigen.eigenvectors() * values.asDiagonal() *
                                 eigen.eigenvectors().transpose();
  }
  EXPECT_LE((made.Matrix() - expected).norm(), 1e-12 * expected.norm());
  EXPECT_GT(negative + low, 0);
  made.ExpectConsistent();
}

// ---- without contacts -------------------------------------------------------

// Nothing touches, nothing is known: P is a multiple of 1, and says so.
TEST(Preconditioners, WithoutContactsAreTheIdentity) {
  Packing packing = ReadData("n64_jammed.xyz");
  packing.ScaleRadii(0.99);
  const auto energy = MakeEnergy(packing, 2.0);
  ASSERT_EQ(Evaluate(*energy).energy, 0.0);
  for (const SolverInfo& info : ListPreconditioners()) {
    SCOPED_TRACE(info.name);
    Made made(energy.get(), info.name);
    EXPECT_TRUE(made.Update(Zero(*energy), nullptr));
    EXPECT_EQ(made.num_fallbacks(), 1);
    const int n = energy->NumParameters();
    EXPECT_EQ((made.Matrix() - MatrixXd::Identity(n, n)).norm(), 0.0);
    made.ExpectConsistent();
  }
}

}  // namespace
}  // namespace granopt
