// granopt: numbers, lists, CSV files and tables as text.

#ifndef GRANOPT_EXPERIMENTS_TABULAR_H_
#define GRANOPT_EXPERIMENTS_TABULAR_H_

#include <cstdint>
#include <map>
#include <string>
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
bool ParsePositives(const std::string& text,
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
// "5e-5", "0.01": as people write it, and read back exactly.
std::string Neat(double value);
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

// The columns of a file, which a function
//
//   void Columns(Record* record, CsvColumns* columns) {
//     columns->Add("seed", &record->seed);
//     ...
//   }
//
// names once: for the header, for writing a row and for reading one.
class CsvColumns {
 public:
  CsvColumns() = default;
  // Reads the reader's row instead of writing one.
  explicit CsvColumns(CsvReader* reader) : reader_(reader) {}

  void Add(const char* name, std::string* value);
  void Add(const char* name, int* value);
  void Add(const char* name, std::int64_t* value);
  void Add(const char* name, std::uint64_t* value);
  void Add(const char* name, bool* value);  // 0 or 1
  void Add(const char* name, double* value, int digits = 17);
  void Add(const char* name, double* value, std::string (*print)(double));

  // Null when writing.
  CsvReader* reader() const { return reader_; }
  // What was written, without the end of the line.
  const std::string& header() const { return header_; }
  const std::string& row() const { return row_; }

 private:
  void Write(const char* name, const std::string& field);

  CsvReader* reader_ = nullptr;
  std::string header_, row_;
};

template <typename Record>
std::string FormatCsv(const std::vector<Record>& records) {
  CsvColumns head;
  Record none{};
  Columns(&none, &head);
  std::string csv = head.header() + "\n";
  for (Record record : records) {
    CsvColumns columns;
    Columns(&record, &columns);
    csv += columns.row() + "\n";
  }
  return csv;
}

// Bit by bit what was written; false with one line in `error`, "name:line:
// what", and `records` left alone, for anything else.
template <typename Record>
bool ParseCsv(const std::string& text,
              const std::string& name,
              std::vector<Record>* records,
              std::string* error) {
  CsvReader reader(text, name);
  if (!reader.Begin(error)) return false;
  std::vector<Record> read;
  while (reader.Row()) {
    Record record{};
    CsvColumns columns(&reader);
    Columns(&record, &columns);
    if (!reader.error().empty()) return Fail(reader.error(), error);
    read.push_back(std::move(record));
  }
  *records = std::move(read);
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

// Numbers of tables; infinite: "never".
std::string Count(double value);
std::string Seconds(double value);
std::string Ratio(double value);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_TABULAR_H_
