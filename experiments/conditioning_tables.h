// granopt: the tables of `conditioning`, made from its files alone.

#ifndef GRANOPT_EXPERIMENTS_CONDITIONING_TABLES_H_
#define GRANOPT_EXPERIMENTS_CONDITIONING_TABLES_H_

#include <string>

#include "experiments/conditioning_records.h"

namespace granopt {

std::string TablesText(const ConditioningRows& rows);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_CONDITIONING_TABLES_H_
