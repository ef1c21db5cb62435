//! A window on an X11 display that shows the stand-in's images, as X-Plane's window does, so that it can be grabbed.
//!
//! Images go into a pixmap that is the window's background: the X server itself repaints the window when something that covered
//! it goes away. An image is visible when [`DisplayWindow::show`] returns: the server has confirmed it.

use std::fmt;
use std::sync::{Mutex, PoisonError};
use std::thread::sleep;
use std::time::{Duration, Instant};

use x11rb::COPY_DEPTH_FROM_PARENT;
use x11rb::connection::{Connection, RequestConnection};
use x11rb::errors::{ConnectionError, ReplyError, ReplyOrIdError};
use x11rb::properties::WmSizeHints;
use x11rb::protocol::Event;
use x11rb::protocol::xproto::{
    AtomEnum, ChangeWindowAttributesAux, ConnectionExt as _, CreateGCAux, CreateWindowAux,
    EventMask, Gcontext, ImageFormat, ImageOrder, Pixmap, PropMode, Screen, Window as WindowId,
    WindowClass,
};
use x11rb::rust_connection::RustConnection;
use x11rb::wrapper::ConnectionExt as _;
use xplane_bridge::link::SimulatorWindow;
use xplane_bridge::pixels::RgbPicture;

/// Title of the window.
const TITLE: &str = "X-Plane stand-in (dtd mock-xplane)";
/// Time for a window manager to map the window.
const MAP_TIMEOUT: Duration = Duration::from_secs(5);
/// The depth of the pixels we send: 32 bits each, with red, green and blue in the lower 24.
const DEPTH: u8 = 24;
const BYTES_PER_PIXEL: usize = 4;

/// Shows images: a window, or in tests something with faults.
pub trait DisplayWindow: fmt::Debug + Send + Sync {
    /// Position and size.
    ///
    /// # Errors
    /// It no longer exists.
    fn describe(&self) -> Result<SimulatorWindow, WindowError>;

    /// Shows an image instead of the previous one. Done when it is visible.
    ///
    /// # Errors
    /// The image has another size than the stage, or the stage no longer exists.
    fn show(&self, picture: &RgbPicture) -> Result<(), WindowError>;
}

/// Reason why images cannot be shown.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct WindowError(String);

/// Conversions of X server and connection errors.
macro_rules! from_x11 {
    ($($error:ty),*) => {
        $(impl From<$error> for WindowError {
            fn from(error: $error) -> Self {
                Self(format!("the X server: {error}"))
            }
        })*
    };
}
from_x11!(ConnectionError, ReplyError, ReplyOrIdError);

/// An open window. It closes when dropped.
pub struct X11Window {
    connection: RustConnection,
    root: WindowId,
    window: WindowId,
    pixmap: Pixmap,
    context: Gcontext,
    width_px: u32,
    height_px: u32,
    /// An image's memory in the format of the display.
    pixels: Mutex<Vec<u8>>,
}

impl X11Window {
    /// Opens a window for images of this size on a display, e.g. `:0`, or on that which `DISPLAY` names.
    ///
    /// # Errors
    /// There is no such display, or it cannot show such a window.
    pub fn open(
        display: Option<&str>,
        (width_px, height_px): (u32, u32),
    ) -> Result<Self, WindowError> {
        let (connection, screen) = connect(display)?;
        let fits = |px: u32, of: u16| u16::try_from(px).ok().filter(|px| (1..=of).contains(px));
        let (width, height) = (screen.width_in_pixels, screen.height_in_pixels);
        let Some((width, height)) = fits(width_px, width).zip(fits(height_px, height)) else {
            return Err(WindowError(format!(
                "a window of {width_px}x{height_px} does not fit on the display, {width}x{height}"
            )));
        };
        let opened = Self {
            window: connection.generate_id()?,
            pixmap: connection.generate_id()?,
            context: connection.generate_id()?,
            root: screen.root,
            connection,
            width_px,
            height_px,
            pixels: Mutex::default(),
        };
        opened.create(&screen, (width, height))?;
        opened.wait_until_mapped()?;
        Ok(opened)
    }

    fn create(&self, screen: &Screen, (width, height): (u16, u16)) -> Result<(), WindowError> {
        let Self {
            connection,
            window,
            pixmap,
            context,
            ..
        } = self;
        let settings = CreateWindowAux::new()
            .background_pixel(screen.black_pixel)
            .event_mask(EventMask::STRUCTURE_NOTIFY);
        connection
            .create_window(
                COPY_DEPTH_FROM_PARENT,
                *window,
                screen.root,
                0,
                0,
                width,
                height,
                0,
                WindowClass::INPUT_OUTPUT,
                screen.root_visual,
                &settings,
            )?
            .check()?;
        connection.create_pixmap(DEPTH, *pixmap, *window, width, height)?;
        connection.create_gc(*context, *pixmap, &CreateGCAux::new().graphics_exposures(0))?;
        let title = TITLE.as_bytes();
        connection.change_property8(
            PropMode::REPLACE,
            *window,
            AtomEnum::WM_NAME,
            AtomEnum::STRING,
            title,
        )?;
        // A different size would mean different images.
        let size = Some((i32::from(width), i32::from(height)));
        WmSizeHints {
            min_size: size,
            max_size: size,
            ..WmSizeHints::default()
        }
        .set_normal_hints(connection, *window)?;
        connection.map_window(*window)?.check()?;
        Ok(())
    }

    fn wait_until_mapped(&self) -> Result<(), WindowError> {
        let began = Instant::now();
        while began.elapsed() < MAP_TIMEOUT {
            match self.connection.poll_for_event()? {
                Some(Event::MapNotify(_)) => return Ok(()),
                Some(_) => {}
                None => sleep(Duration::from_millis(5)),
            }
        }
        Err(WindowError(format!(
            "the window did not appear within {MAP_TIMEOUT:?}"
        )))
    }

    /// Puts an image into the pixmap, in as many requests as the server needs.
    fn put(&self, bytes: &[u8]) -> Result<(), WindowError> {
        let row_bytes = self.width_px as usize * BYTES_PER_PIXEL;
        let request_bytes = self.connection.maximum_request_bytes().saturating_sub(64);
        let rows = (request_bytes / row_bytes).max(1);
        for (number, part) in bytes.chunks(rows * row_bytes).enumerate() {
            self.connection.put_image(
                ImageFormat::Z_PIXMAP,
                self.pixmap,
                self.context,
                self.width_px as u16,
                (part.len() / row_bytes) as u16,
                0,
                (number * rows) as i16,
                0,
                DEPTH,
                part,
            )?;
        }
        Ok(())
    }
}

impl DisplayWindow for X11Window {
    fn describe(&self) -> Result<SimulatorWindow, WindowError> {
        let corner = self
            .connection
            .translate_coordinates(self.window, self.root, 0, 0)?
            .reply()?;
        Ok(SimulatorWindow {
            title: TITLE.into(),
            x_px: corner.dst_x.into(),
            y_px: corner.dst_y.into(),
            width_px: self.width_px,
            height_px: self.height_px,
            scale: 1.0,
        })
    }

    fn show(&self, picture: &RgbPicture) -> Result<(), WindowError> {
        if (picture.width_px, picture.height_px) != (self.width_px, self.height_px) {
            return Err(WindowError(format!(
                "the window is {}x{}, it cannot show an image of {}x{}",
                self.width_px, self.height_px, picture.width_px, picture.height_px
            )));
        }
        let mut pixels = self.pixels.lock().unwrap_or_else(PoisonError::into_inner);
        pixels.clear();
        for [red, green, blue] in picture.rgb.as_chunks().0 {
            pixels.extend([*blue, *green, *red, 0]);
        }
        // The events are never used, but must not pile up.
        while self.connection.poll_for_event()?.is_some() {}
        self.put(&pixels)?;
        // Set again each time: the effect of changing a background's pixmap later is implementation-defined.
        let background = ChangeWindowAttributesAux::new().background_pixmap(self.pixmap);
        self.connection
            .change_window_attributes(self.window, &background)?;
        self.connection
            .clear_area(false, self.window, 0, 0, 0, 0)?
            .check()?;
        self.connection.sync()?;
        Ok(())
    }
}

impl fmt::Debug for X11Window {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("X11Window")
            .field("window", &self.window)
            .field("width_px", &self.width_px)
            .field("height_px", &self.height_px)
            .finish_non_exhaustive()
    }
}

/// Connects to a display, e.g. `:0`, or to the one that `DISPLAY` names, if it has pixels of our form.
fn connect(display: Option<&str>) -> Result<(RustConnection, Screen), WindowError> {
    let connected = RustConnection::connect(display);
    let (connection, screen) = connected.map_err(|error| {
        let named = || std::env::var("DISPLAY").unwrap_or_default();
        let display = display.map_or_else(named, str::to_owned);
        WindowError(format!(
            "cannot open the X11 display {display:?}: {error}. Is DISPLAY set, and does an X server run there (e.g. Xvfb)?"
        ))
    })?;
    let screen = connection.setup().roots[screen].clone();
    check_pixels(&connection, &screen)?;
    Ok((connection, screen))
}

/// Rejects a display whose pixels we would have to convert.
fn check_pixels(connection: &RustConnection, screen: &Screen) -> Result<(), WindowError> {
    let setup = connection.setup();
    let bits = setup
        .pixmap_formats
        .iter()
        .find(|format| format.depth == DEPTH)
        .map_or(0, |format| format.bits_per_pixel);
    let visuals = screen
        .allowed_depths
        .iter()
        .flat_map(|depth| &depth.visuals);
    let masks = visuals
        .into_iter()
        .find(|visual| visual.visual_id == screen.root_visual)
        .map_or((0, 0, 0), |visual| {
            (visual.red_mask, visual.green_mask, visual.blue_mask)
        });
    let order = setup.image_byte_order;
    let fits = screen.root_depth == DEPTH
        && usize::from(bits) == 8 * BYTES_PER_PIXEL
        && masks == (0xff_0000, 0xff00, 0xff)
        && order == ImageOrder::LSB_FIRST;
    if fits {
        return Ok(());
    }
    Err(WindowError(format!(
        "the X11 display has pixels of another form (depth {}, {bits} bits, masks {masks:x?}, {order:?}), expected 24-bit colour in 32 bits, \
         e.g. Xvfb -screen 0 1920x1280x24",
        screen.root_depth
    )))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_display_that_is_not_there_is_named_with_what_to_do() {
        let error = X11Window::open(Some(":54321"), (96, 64)).unwrap_err();
        let text = error.to_string();
        assert!(text.contains(":54321") && text.contains("Xvfb"), "{text}");
    }
}
