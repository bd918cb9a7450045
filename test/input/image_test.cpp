// Images of every encoding: the same scene gives the same grey; invalid images are refused with one
// sentence.

#include "ground_scale_vo/input/image.hpp"

#include <opencv2/imgcodecs.hpp>

#include "support/temporary_folder.hpp"
#include "support/test.hpp"

namespace gsv {
namespace {

constexpr int kWidth = 50, kHeight = 40;

struct TestImage {
  std::string encoding;
  std::uint32_t width = 0, height = 0, step = 0;
  bool is_bigendian = false;
  std::vector<std::uint8_t> data;

  RawImage raw() const {
    return {height, width, encoding, is_bigendian, step, data.data(), data.size()};
  }
};

/// An image whose bytes all are 100.
TestImage plainImage(const std::string& encoding, std::uint32_t width, std::uint32_t height,
                     std::uint32_t step, std::size_t bytes) {
  TestImage image;
  image.encoding = encoding;
  image.width = width;
  image.height = height;
  image.step = step;
  image.data.assign(bytes, 100);
  return image;
}

/// How an encoding stores a pixel.
struct Layout {
  std::string encoding;
  /// Numbers of a pixel in their order: b, g, r; y: brightness; x: not used. For Bayer, the 2 x 2
  /// pattern row by row, of which a pixel has one number.
  std::string channels;
  bool bayer = false;
  int bytes = 1;      ///< of a number
  int tolerance = 1;  ///< of the converted image [grey levels]
};

const std::vector<Layout>& layouts() {
  static const std::vector<Layout> all = [] {
    std::vector<Layout> list = {{"8UC1", "y"},           {"8UC3", "bgr"},
                                {"8UC4", "bgrx"},        {"16UC1", "y", {}, 2},
                                {"16UC3", "bgr", {}, 2}, {"16UC4", "bgrx", {}, 2},
                                {"yuv422", "xy"},        {"yuv422_yuy2", "yx"},
                                {"uyvy", "xy"},          {"yuyv", "yx"}};
    for (const int bytes : {1, 2}) {
      const std::string bits = bytes == 1 ? "8" : "16";
      list.push_back({"mono" + bits, "y", false, bytes});
      for (const char* order : {"bgr", "rgb"}) {
        list.push_back({order + bits, order, false, bytes});
        list.push_back({std::string(order) + "a" + bits, std::string(order) + "x", false, bytes});
      }
      for (const char* pattern : {"rggb", "bggr", "gbrg", "grbg"}) {
        list.push_back({std::string("bayer_") + pattern + bits, pattern, true, bytes, 2});
      }
    }
    return list;
  }();
  return all;
}

/// Scene [0, 255]: linear in u and v, so that the interpolation of a Bayer pattern is exact.
double colour(char channel, int u, int v) {
  if (channel == 'b') return 20 + 3.0 * u + 1.0 * v;
  if (channel == 'g') return 40 + 1.0 * u + 3.0 * v;
  if (channel == 'r') return 235 - 2.0 * u - 2.0 * v;
  if (channel == 'x') return 77;
  return 0.114 * colour('b', u, v) + 0.587 * colour('g', u, v) + 0.299 * colour('r', u, v);
}

std::size_t pixelBytes(const Layout& layout) {
  return (layout.bayer ? 1 : layout.channels.size()) * static_cast<std::size_t>(layout.bytes);
}

/// Image of the scene. unit: the stored number of one grey level. padding: bytes after each row.
TestImage imageOf(const Layout& layout, double unit, std::uint32_t padding = 0,
                  bool big_endian = false) {
  const std::size_t numbers = layout.bayer ? 1 : layout.channels.size();
  const auto bytes = static_cast<std::size_t>(layout.bytes);
  const auto step = static_cast<std::uint32_t>(kWidth * pixelBytes(layout)) + padding;
  TestImage image = plainImage(layout.encoding, kWidth, kHeight, step, std::size_t{step} * kHeight);
  image.is_bigendian = big_endian;
  for (int v = 0; v < kHeight; ++v) {
    for (int u = 0; u < kWidth; ++u) {
      for (std::size_t k = 0; k < numbers; ++k) {
        const char channel = layout.channels[layout.bayer ? 2 * (v % 2) + u % 2 : k];
        const auto number = static_cast<unsigned>(std::lround(unit * colour(channel, u, v)));
        std::uint8_t* const at = &image.data[v * image.step + (u * numbers + k) * bytes];
        if (bytes == 1) {
          at[0] = static_cast<std::uint8_t>(number);
        } else {
          at[big_endian ? 0 : 1] = static_cast<std::uint8_t>(number / 256);
          at[big_endian ? 1 : 0] = static_cast<std::uint8_t>(number % 256);
        }
      }
    }
  }
  return image;
}

/// Largest difference from the scene [grey levels], without the border, which Bayer extrapolates.
double difference(const cv::Mat& grey) {
  if (grey.type() != CV_8UC1 || grey.size() != cv::Size(kWidth, kHeight)) return 1e9;
  double largest = 0;
  for (int v = 1; v + 1 < kHeight; ++v) {
    for (int u = 1; u + 1 < kWidth; ++u) {
      largest = std::max(largest, std::abs(grey.at<std::uint8_t>(v, u) - colour('y', u, v)));
    }
  }
  return largest;
}

TEST(GreyConverter, EveryEncodingOfASceneGivesTheSameGrey) {
  for (const Layout& layout : layouts()) {
    for (const int bits : {8, 10, 12, 14, 16}) {
      if (bits > 8 * layout.bytes) continue;
      SCOPED_TRACE(layout.encoding + " of " + std::to_string(bits) + " bits");
      const double unit = (std::ldexp(1.0, bits) - 1) / 255;
      const TestImage little = imageOf(layout, unit), big = imageOf(layout, unit, 6, true);
      EXPECT_LE(difference(GreyConverter().convert(little.raw())), layout.tolerance);
      EXPECT_LE(difference(GreyConverter().convert(big.raw())), layout.tolerance)
          << "big endian, padded";
    }
  }
}

TEST(GreyConverter, TakesTheBrightnessOfNv12AndLeavesItsColoursOut) {
  TestImage image = imageOf({"mono8", "y"}, 1, 6);
  image.encoding = "nv12";
  image.data.resize(image.data.size() * 3 / 2, 128);
  EXPECT_LE(difference(GreyConverter().convert(image.raw())), 1);
}

/// The grey level of a mono16 image whose pixels are `number`, except the first `bright`, 4095.
std::uint8_t greyOf(GreyConverter* converter, std::uint16_t number, std::size_t bright = 0) {
  constexpr std::uint32_t kSide = 100;
  TestImage image = plainImage("mono16", kSide, kSide, 2 * kSide, 2 * kSide * kSide);
  for (std::size_t k = 0; k < kSide * kSide; ++k) {
    const std::uint16_t n = k < bright ? 4095 : number;
    image.data[2 * k] = static_cast<std::uint8_t>(n % 256);
    image.data[2 * k + 1] = static_cast<std::uint8_t>(n / 256);
  }
  return converter->convert(image.raw()).at<std::uint8_t>(kSide - 1, kSide - 1);
}

TEST(GreyConverter, TheRangeOfSixteenBitsGrowsAtOnceAndShrinksAfterManyDarkImages) {
  constexpr int kMany = GreyConverter::kImagesUntilNarrower;
  GreyConverter converter;
  EXPECT_EQ(greyOf(&converter, 200), 200);
  EXPECT_EQ(greyOf(&converter, 200, 10), 200) << "a few bright pixels";
  EXPECT_EQ(greyOf(&converter, 200, 100), 12);
  EXPECT_EQ(greyOf(&converter, 4095), 255);
  for (int i = 0; i < 2 * kMany; ++i) {
    ASSERT_EQ(greyOf(&converter, 200, i % 50 == 0 ? 5000 : 0), 12) << i;  // not in a row
  }
  EXPECT_EQ(greyOf(&converter, 4095), 255);
  for (int i = 1; i < kMany; ++i) ASSERT_EQ(greyOf(&converter, 200), 12) << i;
  EXPECT_EQ(greyOf(&converter, 200), 50);  // 10 bits
  for (int i = 0; i < 2 * kMany; ++i) greyOf(&converter, 10);
  EXPECT_EQ(greyOf(&converter, 10), 10);  // not below 8 bits
}

TEST(GreyConverter, RefusesEncodingsAndSizesThatDoNotFit) {
  const auto expectRefused = [](const TestImage& image, const std::string& reason) {
    expectThrows<DataError>([&] { GreyConverter().convert(image.raw()); }, reason);
  };
  for (const std::string encoding :
       {"", "jpeg", "mono8 ", "8UC2", "8UC1000000000", "16SC1", "32FC1", "bayer_rggb", "nv16"}) {
    expectRefused(plainImage(encoding, 4, 2, 4, 8),
                  "the encoding \"" + encoding + "\" cannot be converted to grey");
  }
  const struct {
    const char* encoding;
    std::uint32_t width, height, step;
    std::size_t bytes;
    const char* reason;
  } kCases[] = {
      {"mono8", 0, 2, 4, 8, "the image has no pixels"},
      {"mono8", 4, 0, 4, 0, "the image has no pixels"},
      {"mono8", 4, 2, 4, 7, "the image holds 7 bytes instead of 8"},
      {"mono8", 4, 2, 4, 9, "the image holds 9 bytes instead of 8"},
      {"mono8", 4, 2, 6, 10, "the image holds 10 bytes instead of 12"},
      {"mono8", 4, 2, 0, 0, "the step of 0 bytes does not fit 4 pixels of mono8"},
      {"bgr8", 4, 2, 11, 22, "the step of 11 bytes does not fit"},
      {"mono16", 4, 2, 9, 18, "the step of 9 bytes does not fit"},
      {"yuv422_yuy2", 4, 2, 7, 14, "the step of 7 bytes does not fit"},
      {"nv12", 4, 2, 4, 8, "the image holds 8 bytes instead of 12"},
      {"mono8", kMaxUint32, 1, kMaxUint32, 1, "4294967295 x 1 is not plausible for a camera"},
      {"mono8", 1, kMaxUint32, 1, 1, "1 x 4294967295 is not plausible for a camera"},
      // step * height is 2^32, which is 0 in 32 bits.
      {"mono8", 65536, 65536, 65536, 0, "the image holds 0 bytes instead of 4294967296"},
  };
  for (const auto& c : kCases) {
    expectRefused(plainImage(c.encoding, c.width, c.height, c.step, c.bytes), c.reason);
  }
}

using namespace std::string_literals;

// Only marks and headers; nothing decodes the pixels.
const std::string kPng =
    "\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\x01\x02\0\0\0\x03"s + "\0\0\0\0IEND\xae\x42\x60\x82"s;
const std::string kJpeg = "\xff\xd8\xff\xe0\0\x04JF\xff\xc0\0\x0b\x08\0\x03\x01\x02\x01\xff\xd9"s;

TEST(EncodedImage, IsDecodedOnlyIfItIsWhole) {
  std::string huge = kPng;
  huge[16] = huge[20] = '\x7f';  // the most significant bytes of width and height
  for (const std::string& whole : {kPng, kPng + "\0\0\0"s /* padded: MJPEG */, huge}) {
    expectThrows<DataError>([&] { decodePixels(whole); }, "cannot be decoded as an image");
  }
  // OpenCV 4.6 decodes the beginning of a truncated JPEG and only prints a warning.
  for (const std::string& part : {kPng.substr(0, kPng.size() - 1), kPng.substr(0, kPng.size() / 2),
                                  kJpeg.substr(1), kJpeg.substr(0, kJpeg.size() - 1), ""s}) {
    expectThrows<DataError>([&] { decodePixels(part); }, "is not a whole PNG or JPEG image");
  }
}

using ImageFile = TemporaryFolder;

/// The EXIF orientation that says that a viewer should turn a JPEG image.
const std::string kTurn =
    "\xff\xe1\x00\x22"s                                   // APP1, 34 bytes
    "Exif\0\0MM\0\x2a\0\0\0\x08"s                         // big-endian TIFF, first table at 8
    "\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0"s;  // one entry: orientation 6

// The calibration is that of the sensor.
TEST_F(ImageFile, IsNotTurnedByItsOrientation) {
  cv::Mat image(16, 32, CV_8UC1, cv::Scalar(40));
  image.colRange(0, 16) = 200;
  std::vector<unsigned char> jpeg;
  cv::imencode(".jpg", image, jpeg);
  jpeg.insert(jpeg.begin() + 2, kTurn.begin(), kTurn.end());
  ASSERT_EQ(cv::imdecode(jpeg, cv::IMREAD_GRAYSCALE).size(), cv::Size(16, 32));
  const cv::Mat read = readGreyImage(write("turned.jpg", {jpeg.begin(), jpeg.end()}));
  ASSERT_EQ(read.size(), image.size());
  EXPECT_LT(cv::norm(read, image, cv::NORM_INF), 5);
}

}  // namespace
}  // namespace gsv
