#include "experiments/flow.h"

namespace granopt {

const std::vector<Study>& Studies() {
  static const std::vector<Study> studies = {
      {"work_precision",
       {"work_precision.csv", "work_precision.svg", "work_precision.png"},
       {"seeds"},
       WorkPrecision},
      {"remark8",
       {"remark8.csv", "remark8.svg", "remark8.png"},
       {"seeds"},
       Remark8},
      {"oscillator",
       {"frequencies.csv",
        "decay.csv",
        "response.csv",
        "oscillator.svg",
        "oscillator.png"},
       {},
       Oscillator},
      {"throughput",
       {"throughput.csv", "throughput.svg", "throughput.png"},
       {},
       Throughput}};
  return studies;
}

Json StudyJson(const std::string& name) {
  return {{"study", name}, {"schema", "granopt/flow_study/1"}};
}

void FinishStudy(Json json, Output* output) {
  json["provenance"] = Provenance();
  json["provenance"]["threads"] = FLAGS_threads;
  output->WriteJson("summary.json", json);
  output->PrintFiles();
}

}  // namespace granopt
