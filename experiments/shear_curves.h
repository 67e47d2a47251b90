// granopt: curves of stress and fabric against strain.

#ifndef GRANOPT_EXPERIMENTS_SHEAR_CURVES_H_
#define GRANOPT_EXPERIMENTS_SHEAR_CURVES_H_

#include <cstdint>
#include <string>
#include <vector>

#include "experiments/run.h"
#include "granular/quasistatic_shear.h"

namespace granopt {

// A state of a curve. Isotropic and deviatoric parts as in Fig. 8
// (observables.h); `conjugate` is ConjugateStress().
struct StrainRow {
  double increment = 0.0;
  int step = 0;
  double strain = 0.0;
  double energy = 0.0, work = 0.0, dissipated = 0.0;
  double stress_iso = 0.0, stress_dev = 0.0, fabric_iso = 0.0, fabric_dev = 0.0;
  double conjugate = 0.0, pressure = 0.0, shear_stress = 0.0;
  double phi = 0.0, coordination = 0.0;
  int contacts = 0, rattlers = 0;
  std::int64_t iterations = 0, evaluations = 0;
  double residual = 0.0;
  int converged = 1;
};

StrainRow RowOf(double increment,
                DeformationMode mode,
                const QuasistaticShearStep& step);

// A column a member, in their order.
std::string CurvesCsv(const std::vector<StrainRow>& rows);
// Bit by bit what was written; one line in `error` for anything else.
bool ParseCurves(const std::string& csv,
                 std::vector<StrainRow>* rows,
                 std::string* error);

// Curves of a coarser increment against that of the finest one, at the strains
// that both have; differences in parts of the largest stress on the finest.
struct Agreement {
  double increment = 0.0, finest = 0.0;
  // Mean differences of the deviatoric stress over the first tenth of the
  // strain, over all of it, and the strain up to which all are below 1 %.
  double small_strain = 0.0, all = 0.0, agrees_until = 0.0;
  // The same of the deviatoric fabric.
  double small_strain_fabric = 0.0, all_fabric = 0.0;
};
std::vector<Agreement> CompareIncrements(const std::vector<StrainRow>& rows);
std::string AgreementCsv(const std::vector<Agreement>& agreement);
Json AgreementJson(const std::vector<Agreement>& agreement);
// Tables for the terminal; empty for none.
std::string AgreementTable(const std::vector<Agreement>& agreement);
std::string CurvesTable(const std::vector<StrainRow>& rows,
                        DeformationMode mode);
// First and last state, steepest modulus, dissipation, of each increment.
Json CurvesJson(const std::vector<StrainRow>& rows);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_SHEAR_CURVES_H_
