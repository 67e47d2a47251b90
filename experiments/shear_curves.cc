#include "experiments/shear_curves.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <sstream>

#include "experiments/tabular.h"
namespace granopt {
namespace {

constexpr char kHeader[] =
    "increment,step,strain,energy,work,dissipated,stress_iso,stress_dev,"
    "fabric_iso,fabric_dev,conjugate,pressure,shear_stress,phi,coordination,"
    "contacts,rattlers,iterations,evaluations,residual,converged";

// The curves of one increment each, in order.
std::vector<std::vector<StrainRow>> Split(const std::vector<StrainRow>& rows) {
  std::vector<std::vector<StrainRow>> curves;
  for (const StrainRow& row : rows) {
    if (row.step == 0 || curves.empty()) curves.emplace_back();
    curves.back().push_back(row);
  }
  return curves;
}

}  // namespace

StrainRow RowOf(double increment,
                DeformationMode mode,
                const QuasistaticShearStep& step) {
  const Observables& o = step.result->observables;
  StrainRow row;
  row.increment = increment;
  row.step = step.step;
  row.strain = step.strain;
  row.energy = o.energy;
  row.work = step.work;
  row.dissipated = step.dissipated;
  row.stress_iso = o.stress_parts.isotropic;
  row.stress_dev = o.stress_parts.deviatoric;
  row.fabric_iso = o.fabric_parts.isotropic;
  row.fabric_dev = o.fabric_parts.deviatoric;
  row.conjugate = ConjugateStress(mode, o.stress);
  row.pressure = o.pressure;
  row.shear_stress = o.shear_stress;
  row.phi = o.packing_fraction;
  row.coordination = o.coordination;
  row.contacts = o.contacts;
  row.rattlers = o.rattlers;
  row.residual = o.relative_residual;
  if (step.step > 0) {
    row.iterations = step.result->summary.counters.iterations;
    row.evaluations = step.result->summary.counters.evaluations;
    row.converged = step.result->summary.Succeeded() ? 1 : 0;
  }
  return row;
}

std::string CurvesCsv(const std::vector<StrainRow>& rows) {
  std::string csv = std::string(kHeader) + "\n";
  for (const StrainRow& r : rows) {
    csv += Format("%.17g,%d,%.17g", r.increment, r.step, r.strain);
    for (const double value : {r.energy,
                               r.work,
                               r.dissipated,
                               r.stress_iso,
                               r.stress_dev,
                               r.fabric_iso,
                               r.fabric_dev,
                               r.conjugate,
                               r.pressure,
                               r.shear_stress,
                               r.phi,
                               r.coordination}) {
      csv += Format(",%.17g", value);
    }
    csv += Format(",%d,%d,%lld,%lld,%.6g,%d\n",
                  r.contacts,
                  r.rattlers,
                  static_cast<long long>(r.iterations),
                  static_cast<long long>(r.evaluations),
                  r.residual,
                  r.converged);
  }
  return csv;
}

bool ParseCurves(const std::string& csv,
                 std::vector<StrainRow>* rows,
                 std::string* error) {
  rows->clear();
  CsvReader reader(csv, "curves.csv");
  if (!reader.Begin(error)) return false;
  while (reader.Row()) {
    StrainRow r;
    reader.Read("increment", &r.increment);
    reader.Read("step", &r.step);
    reader.Read("strain", &r.strain);
    reader.Read("energy", &r.energy);
    reader.Read("work", &r.work);
    reader.Read("dissipated", &r.dissipated);
    reader.Read("stress_iso", &r.stress_iso);
    reader.Read("stress_dev", &r.stress_dev);
    reader.Read("fabric_iso", &r.fabric_iso);
    reader.Read("fabric_dev", &r.fabric_dev);
    reader.Read("conjugate", &r.conjugate);
    reader.Read("pressure", &r.pressure);
    reader.Read("shear_stress", &r.shear_stress);
    reader.Read("phi", &r.phi);
    reader.Read("coordination", &r.coordination);
    reader.Read("contacts", &r.contacts);
    reader.Read("rattlers", &r.rattlers);
    reader.Read("iterations", &r.iterations);
    reader.Read("evaluations", &r.evaluations);
    reader.Read("residual", &r.residual);
    reader.Read("converged", &r.converged);
    rows->push_back(r);
  }
  return reader.error().empty() || Fail(reader.error(), error);
}

std::vector<Agreement> CompareIncrements(const std::vector<StrainRow>& rows) {
  const std::vector<std::vector<StrainRow>> curves = Split(rows);
  std::vector<Agreement> all;
  if (curves.size() < 2) return all;
  const std::vector<StrainRow>& finest = curves.back();
  // On a path that turns a strain does not say which state is meant.
  for (std::size_t k = 2; k < finest.size(); ++k) {
    if ((finest[k].strain - finest[k - 1].strain) *
            (finest[k - 1].strain - finest[k - 2].strain) <
        0.0) {
      return all;
    }
  }
  double most = 0.0, most_fabric = 0.0;
  for (const StrainRow& row : finest) {
    most = std::max(most, row.stress_dev);
    most_fabric = std::max(most_fabric, row.fabric_dev);
  }
  // Nothing to compare with without forces.
  if (!(most > 0.0)) return all;
  const double end = std::abs(finest.back().strain);
  for (std::size_t k = 0; k + 1 < curves.size(); ++k) {
    Agreement a;
    a.increment = curves[k].front().increment;
    a.finest = finest.front().increment;
    int few = 0, many = 0;
    bool agrees = true;
    std::size_t at = 0;
    for (const StrainRow& row : curves[k]) {
      while (at < finest.size() &&
             std::abs(finest[at].strain) < std::abs(row.strain) - 1e-9 * end) {
        ++at;
      }
      if (row.step == 0 || at == finest.size() ||
          std::abs(finest[at].strain - row.strain) > 1e-9 * end) {
        continue;
      }
      const double stress =
          std::abs(row.stress_dev - finest[at].stress_dev) / most;
      const double fabric =
          std::abs(row.fabric_dev - finest[at].fabric_dev) / most_fabric;
      agrees = agrees && stress < 0.01;
      if (agrees) a.agrees_until = std::abs(row.strain);
      ++many;
      a.all += stress;
      a.all_fabric += fabric;
      if (std::abs(row.strain) <= 0.1 * end * (1.0 + 1e-9)) {
        ++few;
        a.small_strain += stress;
        a.small_strain_fabric += fabric;
      }
    }
    a.all /= std::max(1, many);
    a.all_fabric /= std::max(1, many);
    a.small_strain /= std::max(1, few);
    a.small_strain_fabric /= std::max(1, few);
    all.push_back(a);
  }
  return all;
}

std::string AgreementCsv(const std::vector<Agreement>& agreement) {
  std::string csv =
      "increment,finest,small_strain,all,agrees_until,small_strain_fabric,"
      "all_fabric\n";
  for (const Agreement& a : agreement) {
    csv += Format("%g,%g,%.6g,%.6g,%.6g,%.6g,%.6g\n",
                  a.increment,
                  a.finest,
                  a.small_strain,
                  a.all,
                  a.agrees_until,
                  a.small_strain_fabric,
                  a.all_fabric);
  }
  return csv;
}

Json AgreementJson(const std::vector<Agreement>& agreement) {
  Json json = Json::array();
  for (const Agreement& a : agreement) {
    json.push_back({{"increment", a.increment},
                    {"finest", a.finest},
                    {"small_strain", a.small_strain},
                    {"all", a.all},
                    {"agrees_until", a.agrees_until},
                    {"small_strain_fabric", a.small_strain_fabric},
                    {"all_fabric", a.all_fabric}});
  }
  return json;
}

std::string AgreementTable(const std::vector<Agreement>& agreement) {
  if (agreement.empty()) return "";
  std::string text = Format(
      "\n    against the curve of increment %g, mean differences in parts of "
      "its largest value\n"
      "    increment   stress: first tenth, all of the strain   within 1 %% "
      "until   fabric: first tenth, all\n",
      agreement.front().finest);
  for (const Agreement& a : agreement) {
    text += Format("    %9g   %19.2g, %-17.2g   %16.4g   %19.2g, %.2g\n",
                   a.increment,
                   a.small_strain,
                   a.all,
                   a.agrees_until,
                   a.small_strain_fabric,
                   a.all_fabric);
  }
  return text;
}

std::string CurvesTable(const std::vector<StrainRow>& rows,
                        DeformationMode mode) {
  std::string text = Format(
      "\n    increment   strain   stress iso  stress dev   fabric iso  fabric "
      "dev   %s   dissipated / work       z\n",
      mode == DeformationMode::BULK ? "      phi" : "contacts");
  for (const std::vector<StrainRow>& curve : Split(rows)) {
    double dissipated = 0.0, work = 0.0;
    for (const StrainRow& row : curve) {
      dissipated += row.dissipated;
      work += std::abs(row.work);
      const bool turns = row.step > 0 && &row != &curve.back() &&
                         std::abs((&row + 1)->strain) < std::abs(row.strain);
      const bool shown = &row == &curve.front() || &row == &curve.back() ||
                         (turns && (&row - 1)->step < row.step &&
                          std::abs((&row - 1)->strain) < std::abs(row.strain));
      if (!shown) continue;
      text += Format(
          "    %9g   %6g   %10.4e  %10.4e   %10.5f  %10.5f   %8s   %17s  "
          "%6.4f\n",
          row.increment,
          row.strain,
          row.stress_iso,
          row.stress_dev,
          row.fabric_iso,
          row.fabric_dev,
          mode == DeformationMode::BULK ? Format("%.6f", row.phi).c_str()
                                        : Format("%d", row.contacts).c_str(),
          work > 0.0 ? Format("%.4f", dissipated / work).c_str() : "-",
          row.coordination);
    }
  }
  return text;
}

Json CurvesJson(const std::vector<StrainRow>& rows) {
  Json json = Json::array();
  for (const std::vector<StrainRow>& curve : Split(rows)) {
    double dissipated = 0.0, work = 0.0, most = 0.0;
    for (const StrainRow& row : curve) {
      dissipated += row.dissipated;
      work += row.work;
      most = std::max(most, row.stress_dev);
    }
    Json one;
    one["increment"] = curve.front().increment;
    one["steps"] = curve.back().step;
    one["start"] = {{"stress_iso", curve.front().stress_iso},
                    {"stress_dev", curve.front().stress_dev},
                    {"fabric_iso", curve.front().fabric_iso},
                    {"fabric_dev", curve.front().fabric_dev}};
    one["end"] = {{"stress_iso", curve.back().stress_iso},
                  {"stress_dev", curve.back().stress_dev},
                  {"fabric_iso", curve.back().fabric_iso},
                  {"fabric_dev", curve.back().fabric_dev},
                  {"coordination", curve.back().coordination},
                  {"phi", curve.back().phi}};
    if (curve.size() > 1) {
      one["first_modulus"] = (curve[1].conjugate - curve[0].conjugate) /
                             (curve[1].strain - curve[0].strain);
    }
    one["most_stress_dev"] = most;
    one["work"] = work;
    one["dissipated"] = dissipated;
    json.push_back(one);
  }
  return json;
}

}  // namespace granopt
