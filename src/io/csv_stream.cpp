#include "ground_scale_vo/io/csv_stream.hpp"

#include <locale>

namespace ground_scale_vo {

std::ostringstream csvStream(const std::string& heading) {
  std::ostringstream stream;
  stream.imbue(std::locale::classic());
  stream.precision(10);
  stream << heading << '\n';
  return stream;
}

}  // namespace ground_scale_vo
