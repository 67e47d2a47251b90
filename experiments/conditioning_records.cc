#include "experiments/conditioning_records.h"

namespace granopt {

void Columns(ConditionRow* row, CsvColumns* columns) {
  columns->Add("seed", &row->seed);
  columns->Add("distance", &row->distance, Neat);
  columns->Add("preconditioner", &row->label);
  columns->Add("spec", &row->spec);
  columns->Add("shear", &row->shear);
  columns->Add("found", &row->found);
  columns->Add("dimensions", &row->dimensions);
  columns->Add("lowest", &row->lowest, 9);
  columns->Add("highest", &row->highest, 9);
  columns->Add("condition", &row->number, 9);
  columns->Add("negative", &row->negative);
  columns->Add("below_half", &row->below);
  columns->Add("above_two", &row->above);
  columns->Add("message", &row->message);
}

void Columns(ChangeRow* row, CsvColumns* columns) {
  columns->Add("seed", &row->seed);
  columns->Add("distance", &row->distance, Neat);
  columns->Add("shear", &row->shear);
  columns->Add("strain", &row->strain, 9);
  columns->Add("kind", &row->kind);
  columns->Add("relaxed", &row->relaxed);
  columns->Add("contacts", &row->contacts);
  columns->Add("deformed_opened", &row->deformed.opened);
  columns->Add("deformed_closed", &row->deformed.closed);
  columns->Add("relaxation_opened", &row->relaxation.opened);
  columns->Add("relaxation_closed", &row->relaxation.closed);
  columns->Add("step_opened", &row->step.opened);
  columns->Add("step_closed", &row->step.closed);
  columns->Add("newton_shift", &row->newton_shift, 9);
  columns->Add("newton_length", &row->newton_length, 9);
  columns->Add("newton_first", &row->newton_first, 9);
  columns->Add("newton_opened", &row->newton_opened);
  columns->Add("newton_closed", &row->newton_closed);
  columns->Add("predicted_opened", &row->predicted.opened);
  columns->Add("predicted_closed", &row->predicted.closed);
  columns->Add("missed_opened", &row->missed.opened);
  columns->Add("missed_closed", &row->missed.closed);
  columns->Add("message", &row->message);
}

}  // namespace granopt
