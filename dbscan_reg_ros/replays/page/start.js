
// The page of a replay.

const page = new Page();
const ready = Promise.all([unpackScans(), page.plotted, ...page.view.maps.map(map => map && map.ready)]).then(() => {
  page.view.changed();
  document.body.dataset.ready = 'yes';
});
