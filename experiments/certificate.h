// granopt: the certificate that experiments give to the packing they end with,
// and the flags that ask for it.

#ifndef GRANOPT_EXPERIMENTS_CERTIFICATE_H_
#define GRANOPT_EXPERIMENTS_CERTIFICATE_H_

#include <string>
#include <vector>

#include "experiments/run.h"
#include "granular/contact_energy.h"
#include "granular/stability.h"

namespace granopt {

// BadInput for values of --modes that make no sense.
void CheckCertificateFlags();

// What PublishCertificate() may write, for Output::Create().
std::vector<std::string> WithCertificateFiles(std::vector<std::string> names);

// If --certify: certifies `packing` as it is, adds "certificate" to `json` and
// returns the line "certificate   strict minimum: ..." of the report. With
// --modes=K also writes modes.csv, modes.xyz (the packing with a vector mode_k
// a grain) and the figure mode.svg, for which
// `contacts` names the file of contacts in `output`.
// Without being asked, packings whose factors would be large are left alone.
std::string PublishCertificate(const Packing& packing,
                               const ContactEnergyOptions& energy,
                               const std::string& contacts,
                               Output* output,
                               Json* json);

// mode,eigenvalue,relative_eigenvalue,frequency,participation,half,residual:
// eigenvalue in energy / length^2, relative to the mean stiffness kappa,
// frequency sqrt(relative_eigenvalue), negative where that is negative (an
// unstable mode), half: grains that carry half of the mode.
std::string ModesCsv(const Certificate& certificate);

// The packing with columns mode_1:R:3 ... of unit norm over all grains.
std::string FormatModes(const Packing& packing, const Certificate& certificate);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_CERTIFICATE_H_
