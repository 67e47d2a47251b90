#include "experiments/certificate.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include "experiments/scene.h"
#include "granular/packing_io.h"

DEFINE_bool(certify,
            true,
            "prove that the result is a strict minimum (by factors of its "
            "Hessian; not by default where those are large)");
DEFINE_int32(modes,
             0,
             "write this many of the lowest normal modes, and draw the lowest");

namespace granopt {
namespace {

// The largest packings that are certified without being asked: a few seconds.
constexpr int kManyDiscs = 50000;
constexpr int kManySpheres = 2000;

Json CertificateJson(const Certificate& c, double seconds) {
  Json json;
  json["verdict"] = StabilityVerdictName(c.verdict);
  json["strict_minimum"] = c.IsStrictMinimum();
  json["message"] = c.message;
  json["grains"] = c.grains;
  json["contacts"] = c.contacts;
  json["pieces"] = c.pieces;
  json["residual"] = c.residual;
  json["other_force"] = c.other_force;
  json["mean_stiffness"] = c.stiffness;
  json["mean_overlap"] = c.mean_overlap;
  if (!c.modes.empty()) {
    json["lowest_eigenvalue"] = c.lowest_eigenvalue;
    json["participation"] = c.modes[0].participation;
    json["half_grains"] = c.modes[0].carriers.size();
  }
  if (c.contacts > 0) json["smallest_overlap"] = c.smallest_overlap;
  if (std::isfinite(c.smallest_gap)) json["smallest_gap"] = c.smallest_gap;
  if (c.IsStrictMinimum()) {
    json["newton_step"] = c.newton_step;
    json["distance"] = c.distance;
    json["excess_energy"] = c.excess_energy;
    json["undecided_pairs"] = c.undecided_pairs;
  }
  json["seconds"] = seconds;
  return json;
}

}  // namespace

void CheckCertificateFlags() {
  CheckRange("modes", FLAGS_modes, 0, 1000);
  if (FLAGS_modes > 0 && !FLAGS_certify) {
    BadInput("--modes needs --certify");
  }
}

std::vector<std::string> WithCertificateFiles(std::vector<std::string> names) {
  names.insert(names.end(), {"modes.csv", "modes.xyz", "mode.svg", "mode.png"});
  return names;
}

std::string ModesCsv(const Certificate& certificate) {
  std::string csv =
      "mode,eigenvalue,relative_eigenvalue,frequency,participation,half,"
      "residual\n";
  int k = 0;
  for (const NormalMode& mode : certificate.modes) {
    const double relative = mode.eigenvalue / certificate.stiffness;
    csv += Format("%d,%.17g,%.17g,%.17g,%.17g,%d,%.3g\n",
                  ++k,
                  mode.eigenvalue,
                  relative,
                  std::copysign(std::sqrt(std::abs(relative)), relative),
                  mode.participation,
                  static_cast<int>(mode.carriers.size()),
                  mode.residual);
  }
  return csv;
}

std::string FormatModes(const Packing& packing,
                        const Certificate& certificate) {
  std::vector<GrainVectors> columns;
  for (const NormalMode& mode : certificate.modes) {
    columns.push_back(
        {Format("mode_%zu", columns.size() + 1), &mode.displacement});
  }
  return FormatPacking(packing, columns);
}

std::string PublishCertificate(const Packing& packing,
                               const ContactEnergyOptions& options,
                               const std::string& contacts,
                               Output* output,
                               Json* json) {
  if (!FLAGS_certify) return "";
  const int many = packing.dimension() == 3 ? kManySpheres : kManyDiscs;
  if (packing.size() > many && !IsGiven("certify") && !IsGiven("modes")) {
    return Format(
        "certificate   none: factors of more than %d %s are large; "
        "--certify asks for it\n",
        many,
        packing.dimension() == 3 ? "spheres" : "discs");
  }
  std::string error;
  const std::unique_ptr<ContactEnergy> energy =
      ContactEnergy::Create(packing, options, &error);
  if (energy == nullptr) BadInput(error);
  const std::vector<double> zero(energy->NumParameters(), 0.0);
  StabilityOptions stability;
  stability.modes = std::max(1, FLAGS_modes);
  stability.vanishing_tolerance = MakeSolveOptions().vanishing_tolerance;
  const double start = WallSeconds();
  const Certificate certificate = Certify(*energy, zero.data(), stability);
  const double seconds = WallSeconds() - start;
  (*json)["certificate"] = CertificateJson(certificate, seconds);
  if (FLAGS_modes > 0 && !certificate.modes.empty()) {
    output->Write("modes.csv", ModesCsv(certificate));
    output->Write("modes.xyz", FormatModes(packing, certificate));
    output->Plot({"mode",
                  output->Path("modes.xyz"),
                  output->Path(contacts),
                  output->Path("modes.csv"),
                  output->Path("mode")},
                 {"mode.svg", "mode.png"});
  }
  return Format("certificate   %s: %s\n",
                StabilityVerdictName(certificate.verdict),
                certificate.message.c_str());
}

}  // namespace granopt
