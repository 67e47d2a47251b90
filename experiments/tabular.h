// granopt: numbers, lists, CSV files and tables as text.

#ifndef GRANOPT_EXPERIMENTS_TABULAR_H_
#define GRANOPT_EXPERIMENTS_TABULAR_H_

#include <cstdint>
#include <map>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

namespace granopt {

// False, with `line` in `error`.
bool Fail(const std::string& line, std::string* error);

// The whole text is one number.
bool ParseDouble(const std::string& text, double* value);
bool ParseInteger(const std::string& text, std::int64_t* value);
// Without spaces at the ends.
std::string Trimmed(const std::string& text);
// The trimmed parts between separators, empty ones included.
std::vector<std::string> Split(const std::string& text, char separator);
// "1,2,3": finite numbers and nothing else.
bool ParseNumbers(const std::string& text, std::vector<double>* values);
// "1e-2,1e-3": numbers that are all positive, each once; else one line in
// `error`.
bool ParseNumbers(const std::string& text,
                  std::vector<double>* numbers,
                  std::string* error);
// "1-3,7", each once.
bool ParseSeeds(const std::string& text,
                std::vector<std::uint64_t>* seeds,
                std::string* error);

// ---------------------------------------------------------------- CSV

// Quoted if it must be.
std::string Field(const std::string& text);
std::string Number(double value, int digits = 17);
std::string Number(std::int64_t value);
std::string Number(int value);
// A header of the columns and a line a row, each of as many numbers.
std::string NumbersCsv(const std::vector<std::string>& columns,
                       const std::vector<std::vector<double>>& rows);

// Reads rows by the names of their columns.
class CsvReader {
 public:
  // `text` must outlive the reader; `name` is for error lines.
  CsvReader(const std::string& text, const std::string& name)
      : text_(text), name_(name) {}

  // The header.
  bool Begin(std::string* error);
  // The next row; false at the end.
  bool Row();
  bool Has(const char* column) const { return columns_.count(column) > 0; }

  void Read(const char* column, std::string* value);
  void Read(const char* column, double* value);
  void Read(const char* column, std::int64_t* value);
  void Read(const char* column, int* value);
  void Read(const char* column, std::uint64_t* value);
  void Read(const char* column, bool* value);  // 0 or 1
  void Complain(const std::string& what) { Complain(line_, what); }

  // The first complaint, "name:line: what".
  const std::string& error() const { return error_; }

 private:
  void NotNumber(const char* column, const std::string& text);
  void Complain(int line, const std::string& what);
  bool Next(std::vector<std::string>* fields);

  const std::string& text_;
  const std::string name_;
  std::size_t at_ = 0;
  int line_ = 0;
  std::map<std::string, std::size_t> columns_;
  std::vector<std::string> row_;
  std::string error_;
};

// Tables of one struct a row, whose columns are named once: columns(row, visit)
// calls visit("name", row.name) for each, or visit("name", row.name, digits).
template <typename Row, typename Columns>
std::string RowsCsv(const std::vector<Row>& rows, const Columns& columns) {
  std::string csv;
  const Row head{};
  columns(head, [&csv](const char* name, const auto&, int = 17) {
    csv += (csv.empty() ? "" : ",") + std::string(name);
  });
  csv += "\n";
  for (const Row& row : rows) {
    std::string line;
    columns(row, [&line](const char*, const auto& value, int digits = 17) {
      line += line.empty() ? "" : ",";
      if constexpr (std::is_same_v<decltype(value), const double&>) {
        line += Number(value, digits);
      } else {
        line += Number(value);
      }
    });
    csv += line + "\n";
  }
  return csv;
}

// Bit by bit what was written; false with one line in `error`, and `rows` left
// alone, for anything else. `name` is for that line.
template <typename Row, typename Columns>
bool ParseRows(const std::string& csv,
               const std::string& name,
               const Columns& columns,
               std::vector<Row>* rows,
               std::string* error) {
  CsvReader reader(csv, name);
  if (!reader.Begin(error)) return false;
  std::vector<Row> read;
  while (reader.Row()) {
    Row row{};
    columns(row, [&reader](const char* column, auto& value, int = 17) {
      reader.Read(column, &value);
    });
    read.push_back(row);
  }
  if (!reader.error().empty()) return Fail(reader.error(), error);
  *rows = std::move(read);
  return true;
}

// ---------------------------------------------------------------- text

// Characters, not bytes.
int Width(const std::string& text);

// The first `names` columns to the left, the others to the right, but for the
// last `words` ones.
std::string Grid(const std::vector<std::vector<std::string>>& rows,
                 int words,
                 bool markdown,
                 int names = 1);

// "5e-5", "0.01": a number as people write it, without loss.
std::string Neat(double value);
// Numbers of tables; infinite: "never".
std::string Count(double value);
std::string Seconds(double value);
std::string Ratio(double value);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_TABULAR_H_
