#include "granular/contact_kernel.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <tuple>

#include "granular/contact_law.h"

namespace granopt {
namespace {

template <int D, typename Law>
class Kernel final : public ContactKernel {
 public:
  explicit Kernel(double alpha) : law_(alpha) {}

  void States(const PairView& pairs,
              const double* w,
              PairState* states) const override {
    for (int i = 0; i < pairs.num_grains; ++i) {
      for (int p = pairs.row_start[i]; p < pairs.row_start[i + 1]; ++p) {
        states[p] = State(pairs, w, i, p);
      }
    }
  }

  void AddBlocks(const PairView& pairs,
                 const PairState* states,
                 const double* first,
                 const double* second,
                 const int* rank,
                 const int* column_start,
                 double* values) const override {
    for (int i = 0; i < pairs.num_grains; ++i) {
      for (int p = pairs.row_start[i]; p < pairs.row_start[i + 1]; ++p) {
        const int j = pairs.j[p];
        if (j == i) continue;  // an image moves with its grain
        const PairState& state = states[p];
        if (rank[p] < 0 || state.distance == 0.0) continue;
        const double tangential = second[p] / state.distance;
        const double normal = first[p] + tangential;
        for (int c = 0; c < D; ++c) {
          double* diagonal_i = values + column_start[D * i + c];
          double* diagonal_j = values + column_start[D * j + c];
          double* below = diagonal_i + (D - c) + D * rank[p];
          for (int r = 0; r < D; ++r) {
            const double k = normal * state.normal[r] * state.normal[c] -
                             (r == c ? tangential : 0.0);
            if (r >= c) {
              diagonal_i[r - c] += k;
              diagonal_j[r - c] += k;
            }
            below[r] -= k;
          }
        }
      }
    }
  }

  void Apply(int m,
             const double* delta,
             double* force,
             double* stiffness) const override {
    for (int p = 0; p < m; ++p) {
      force[p] = law_.Force(delta[p]);
      stiffness[p] = law_.Stiffness(delta[p]);
    }
  }

  void HessianTimes(const PairView& pairs,
                    const double* w,
                    const double* v,
                    double* hv) const override {
    std::fill(hv, hv + D * pairs.num_grains, 0.0);
    for (int i = 0; i < pairs.num_grains; ++i) {
      for (int p = pairs.row_start[i]; p < pairs.row_start[i + 1]; ++p) {
        const int j = pairs.j[p];
        const PairState state = State(pairs, w, i, p);
        if (!(state.delta > 0.0) || state.distance == 0.0) continue;
        const double tangential = state.force / state.distance;
        double dv[D];
        double along = 0.0;
        for (int c = 0; c < D; ++c) {
          dv[c] = v[D * i + c] - v[D * j + c];
          along += state.normal[c] * dv[c];
        }
        along *= state.stiffness + tangential;
        for (int c = 0; c < D; ++c) {
          const double h = along * state.normal[c] - tangential * dv[c];
          hv[D * i + c] += h;
          hv[D * j + c] -= h;
        }
      }
    }
  }

 private:
  PairState State(const PairView& pairs, const double* w, int i, int p) const {
    const int j = pairs.j[p];
    PairState state;
    double r[D];
    double change = 0.0, d2 = 0.0;
    for (int c = 0; c < D; ++c) {
      const double s = w[D * i + c] - w[D * j + c];
      const double r0 = pairs.r0[c][p];
      r[c] = r0 + s;
      change += s * (r0 + r[c]);
      d2 += r[c] * r[c];
    }
    const double d = std::sqrt(d2);
    state.distance = d;
    state.delta = pairs.delta0[p] - change / (d + pairs.d0[p]);
    for (int c = 0; c < 3; ++c) {
      state.normal[c] = c < D && d > 0.0 ? r[c < D ? c : 0] / d : 0.0;
    }
    const double k = pairs.stiffness == nullptr ? 1.0 : pairs.stiffness[p];
    const bool touching = state.delta > 0.0;
    state.energy = touching ? k * law_.Energy(state.delta) : 0.0;
    state.force = touching ? k * law_.Force(state.delta) : 0.0;
    state.stiffness = touching ? k * law_.Stiffness(state.delta) : 0.0;
    return state;
  }

  const Law law_;
};

template <int D, std::size_t kIndex = 0>
std::unique_ptr<ContactKernel> Make(double alpha) {
  if constexpr (kIndex == std::tuple_size_v<ContactLaws>) {
    return nullptr;
  } else {
    using Law = std::tuple_element_t<kIndex, ContactLaws>;
    if (Law::Handles(alpha)) return std::make_unique<Kernel<D, Law>>(alpha);
    return Make<D, kIndex + 1>(alpha);
  }
}

}  // namespace

std::unique_ptr<ContactKernel> MakeContactKernel(int dimension, double alpha) {
  if (dimension == 2) return Make<2>(alpha);
  if (dimension == 3) return Make<3>(alpha);
  return nullptr;
}

}  // namespace granopt
