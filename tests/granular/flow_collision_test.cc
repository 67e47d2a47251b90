#include <algorithm>
#include <cmath>
#include <vector>

#include "granular/flow/collision.h"
#include "granular/flow/near_field_loops.h"
#include "gtest/gtest.h"
#include "solvers/random.h"

namespace granopt {
namespace {

// Grains as ApplyImpacts() wants them.
struct Bodies {
  explicit Bodies(int count)
      : n(count),
        stride(FlowStride(count)),
        x(3 * stride, 0.0),
        v(3 * stride, 0.0),
        force(3 * stride, 0.0),
        mass(stride, 1.0),
        inverse_mass(stride, 1.0),
        radius(stride, 0.5) {}
  void SetMass(int i, double m) {
    mass[i] = m;
    inverse_mass[i] = 1.0 / m;
  }
  double Kinetic(const std::vector<double>& u) const {
    double sum = 0.0;
    for (int i = 0; i < n; ++i) {
      for (int k = 0; k < 3; ++k) {
        sum += 0.5 * mass[i] * u[k * stride + i] * u[k * stride + i];
      }
    }
    return sum;
  }
  std::vector<double> Collide(const ImpactOptions& options,
                              double step,
                              bool with_force,
                              ImpactWork* work) const {
    ContactSearch search;
    std::vector<ClosePair> pairs;
    search.Find(n, stride, x.data(), radius.data(), 0.0, &pairs);
    std::vector<Impact> impacts;
    FreezeImpacts(pairs, options, stride, v.data(), &impacts);
    std::vector<double> u = v;
    *work = ApplyImpacts(impacts,
                         options,
                         step,
                         stride,
                         inverse_mass.data(),
                         with_force ? force.data() : nullptr,
                         u.data());
    return u;
  }

  int n, stride;
  std::vector<double> x, v, force, mass, inverse_mass, radius;
};

// (3.14) as printed, for v_in after the impact, and (3.12) for v_jn.
void PaperVelocities(double e,
                     double mi,
                     double mj,
                     double vi,
                     double vj,
                     double Ei,
                     double Ej,
                     double dt,
                     double* vi_after,
                     double* vj_after) {
  const double dt1 = dt / (1.0 + e), dt2 = e * dt / (1.0 + e);
  const double D1 = (Ei / mi - Ej / mj) * dt1;
  const double D2 = (Ei / mi - Ej / mj) * dt2;
  *vi_after = (mi * vi + mj * (vj - e * (vi - vj))) / (mi + mj) +
              ((Ei + Ej) * dt - mj * (e * D1 - D2)) / (mi + mj);
  *vj_after = *vi_after - D2 + e * (vi - vj + D1);
}

TEST(Collision, NormalImpulseSolvesThePapersBalance) {
  UniformRandom random(1);
  const auto in = [&](double low, double high) {
    return low + (high - low) * random();
  };
  double worst = 0.0;
  for (int trial = 0; trial < 10000; ++trial) {
    const double e = in(0.0, 1.0), mi = in(0.1, 10.0), mj = in(0.1, 10.0);
    const double vi = in(-1.0, 1.0), vj = in(-1.0, 1.0);
    const double Ei = in(-5.0, 5.0), Ej = in(-5.0, 5.0), dt = in(0.0, 0.1);
    const double m = mi * mj / (mi + mj);
    const double pull = (Ei / mi - Ej / mj) * dt;
    const double p = NormalImpulse(e, m, vi - vj, pull);
    const double bracket = vi - vj + pull / (1.0 + e);
    if (bracket <= 0.0) {
      EXPECT_EQ(p, 0.0);
      continue;
    }
    double vi_after, vj_after;
    PaperVelocities(e, mi, mj, vi, vj, Ei, Ej, dt, &vi_after, &vj_after);
    // m_i v_in(t + dt) = m_i v_in - P + E_in dt  (3.16).
    worst = std::max(worst, std::fabs(vi_after - (vi - p / mi + Ei * dt / mi)));
    worst = std::max(worst, std::fabs(vj_after - (vj + p / mj + Ej * dt / mj)));
  }
  EXPECT_LE(worst, 2e-14);
}

TEST(Collision, RestitutionFollowsTheVelocity) {
  ImpactOptions options;
  options.restitution = 0.5;
  EXPECT_EQ(Restitution(options, 3.0), 0.5);
  options.is_velocity_dependent = true;
  EXPECT_DOUBLE_EQ(Restitution(options, 0.2), 0.5 * 0.8);
  EXPECT_EQ(Restitution(options, 5.0), 0.1);
}

// e of a frozen impact is that of the normal velocities at the start of the
// step, however they slide.
TEST(Collision, FrozenImpactsKnowTheirRestitution) {
  const int stride = FlowStride(3);
  std::vector<double> v(3 * stride, 0.0);
  v[0] = 0.3, v[1] = -0.1, v[2] = 5.0;
  v[stride] = 7.0;
  std::vector<ClosePair> pairs(2);
  pairs[0].i = 0, pairs[0].j = 1, pairs[0].normal[0] = 1.0;
  pairs[1].i = 1, pairs[1].j = 2, pairs[1].normal[0] = -1.0;
  ImpactOptions options;
  options.restitution = 0.5;
  options.velocity_scale = 2.0;
  std::vector<Impact> impacts;
  FreezeImpacts(pairs, options, stride, v.data(), &impacts);
  ASSERT_EQ(impacts.size(), 2u);
  EXPECT_EQ(impacts[0].restitution, 0.5);
  EXPECT_EQ(impacts[1].normal[0], -1.0);
  options.is_velocity_dependent = true;
  FreezeImpacts(pairs, options, stride, v.data(), &impacts);
  ASSERT_EQ(impacts.size(), 2u);
  // (5.13): 0.5 (1 - 0.4 / 2), and e- at 5.1 m/s.
  EXPECT_NEAR(impacts[0].restitution, 0.4, 1e-15);
  EXPECT_NEAR(impacts[1].restitution, 0.1, 1e-15);
}

TEST(Collision, HeadOn) {
  Bodies two(2);
  two.x[1] = 0.99;
  two.v[0] = 1.0;
  two.v[1] = -1.0;
  ImpactWork work;
  for (const double e : {0.0, 0.5, 1.0}) {
    ImpactOptions options;
    options.restitution = e;
    const auto u = two.Collide(options, 0.01, false, &work);
    EXPECT_NEAR(u[0], -e, 1e-15);
    EXPECT_NEAR(u[1], e, 1e-15);
    // (4.1): T(t + dt) - T(t) = T (e^2 - 1).
    EXPECT_NEAR(work.normal, e * e - 1.0, 1e-15);
  }
  // Grains that separate are let go.
  two.v[0] = -1.0;
  two.v[1] = 1.0;
  EXPECT_EQ(two.Collide({}, 0.01, false, &work), two.v);
  EXPECT_EQ(work.impulses, 0);
}

TEST(Collision, StickAndSlip) {
  // Equal grains, approach 2 a along x, slide 2 s along y, (5.6)-(5.11).
  Bodies two(2);
  two.x[1] = 0.99;
  const double a = 1.0;
  ImpactOptions options;
  options.restitution = 0.5;
  options.friction = {0.2, 0.1};
  ImpactWork work;
  // Stick: |I_f| = m s <= mu_s (1 + e) m a.
  for (const double s : {0.0, 0.1, 0.2999}) {
    two.v[0] = a, two.v[1] = -a;
    two.v[two.stride] = s, two.v[two.stride + 1] = -s;
    const auto u = two.Collide(options, 0.01, false, &work);
    EXPECT_EQ(work.sticking, 1) << s;
    EXPECT_NEAR(u[two.stride], 0.0, 1e-15);
    EXPECT_NEAR(u[0], -0.5, 1e-15);
    EXPECT_NEAR(work.friction, -s * s, 1e-15);
  }
  // Slip (5.11): v_t - (1 + e) v_n mu_d.
  for (const double s : {0.3001, 2.0}) {
    two.v[two.stride] = s, two.v[two.stride + 1] = -s;
    const auto u = two.Collide(options, 0.01, false, &work);
    EXPECT_EQ(work.sticking, 0) << s;
    EXPECT_NEAR(u[two.stride], s - 1.5 * 0.1, 1e-15);
    EXPECT_NEAR(u[two.stride + 1], -s + 1.5 * 0.1, 1e-15);
  }
}

// 10^4 random collisions, of pairs and of clusters: T falls, for e = 1 without
// friction it stays, the booked work is the change, momentum stays.
TEST(Collision, NeverRaisesEnergy) {
  UniformRandom random(5);
  int impulses = 0;
  for (int trial = 0; trial < 10000; ++trial) {
    const int n = 2 + trial % 4;
    Bodies bodies(n);
    for (int i = 0; i < n; ++i) {
      bodies.SetMass(i, 0.2 + random());
      for (int k = 0; k < 3; ++k) {
        bodies.x[k * bodies.stride + i] = 0.9 * (random() - 0.5);
        bodies.v[k * bodies.stride + i] = 2.0 * random() - 1.0;
      }
    }
    ImpactOptions options;
    const bool is_elastic = trial % 3 == 0;
    options.restitution = is_elastic ? 1.0 : random();
    if (!is_elastic) {
      options.friction.mu_static = random();
      options.friction.mu_dynamic = options.friction.mu_static * random();
    }
    ImpactWork work;
    const auto u = bodies.Collide(options, 0.01, false, &work);
    impulses += work.impulses;
    const double before = bodies.Kinetic(bodies.v), after = bodies.Kinetic(u);
    EXPECT_LE(work.normal, 1e-14 * before);
    EXPECT_LE(work.friction, 1e-14 * before);
    EXPECT_NEAR(after - before, work.normal + work.friction, 1e-13 * before);
    if (is_elastic) {
      EXPECT_NEAR(after, before, 1e-13 * before);
    }
    for (int k = 0; k < 3; ++k) {
      double p = 0.0;
      for (int i = 0; i < n; ++i) {
        p += bodies.mass[i] *
             (u[k * bodies.stride + i] - bodies.v[k * bodies.stride + i]);
      }
      EXPECT_NEAR(p, 0.0, 1e-14);
    }
  }
  EXPECT_GT(impulses, 10000);
}

// A ball between two that it approaches both: impulses of one moment, added up,
// would raise T to 1.75 of what it was.
TEST(Collision, ThreeBallsKeepTheirEnergy) {
  Bodies three(3);
  three.x[0] = 0.0;
  three.x[1] = 0.99 * std::cos(0.6);
  three.x[2] = 0.99 * std::cos(0.6);
  three.x[three.stride + 1] = 0.99 * std::sin(0.6);
  three.x[three.stride + 2] = -0.99 * std::sin(0.6);
  three.v[0] = 1.0;
  ImpactOptions options;
  options.restitution = 1.0;
  ImpactWork work;
  const auto u = three.Collide(options, 0.01, false, &work);
  EXPECT_EQ(work.impulses, 2);
  EXPECT_NEAR(three.Kinetic(u) / three.Kinetic(three.v), 1.0, 1e-14);
}

// A grain that is held in place has no inverse mass.
TEST(Collision, PinnedGrainReflects) {
  Bodies two(2);
  two.inverse_mass[1] = 0.0;
  two.x[1] = 0.99;
  two.v[0] = 1.0;
  ImpactOptions options;
  options.restitution = 0.7;
  ImpactWork work;
  const auto u = two.Collide(options, 0.01, false, &work);
  EXPECT_NEAR(u[0], -0.7, 1e-15);
  EXPECT_EQ(u[1], 0.0);
  // What it gave to the other.
  EXPECT_NEAR(work.fixed[0], -1.7, 1e-15);
}

TEST(ContactSearch, FindsWhatComparingAllFinds) {
  UniformRandom random(9);
  for (const int n : {1, 2, 50, 97, 400, 3000}) {
    for (const double period : {0.0, 1.0}) {
      const int stride = FlowStride(n);
      std::vector<double> x(3 * stride, 0.0), radius(n);
      for (int i = 0; i < n; ++i) {
        radius[i] = 0.5 * (0.5 + random()) * std::cbrt(1.0 / n) * 0.7;
        for (int k = 0; k < 3; ++k) x[k * stride + i] = 1.1 * (random() - 0.5);
      }
      ContactSearch search;
      std::vector<ClosePair> pairs;
      search.Find(n, stride, x.data(), radius.data(), period, &pairs);
      std::size_t at = 0;
      for (int i = 0; i < n; ++i) {
        for (int j = i + 1; j < n; ++j) {
          double square = 0.0, d[3];
          for (int k = 0; k < 3; ++k) {
            d[k] = x[k * stride + j] - x[k * stride + i];
            if (period > 0.0) d[k] -= std::nearbyint(d[k]);
            square += d[k] * d[k];
          }
          const double range = radius[i] + radius[j];
          if (!(square < range * range)) continue;
          ASSERT_LT(at, pairs.size()) << n << " " << period;
          EXPECT_EQ(pairs[at].i, i);
          EXPECT_EQ(pairs[at].j, j);
          EXPECT_DOUBLE_EQ(pairs[at].normal[0] * pairs[at].distance, d[0]);
          ++at;
        }
      }
      EXPECT_EQ(at, pairs.size()) << n << " " << period;
    }
  }
}

}  // namespace
}  // namespace granopt
